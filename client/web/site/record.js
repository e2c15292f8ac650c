// Records a person's hand as a camera path in time (docs/formats/camera.md). This is a bundle of its own, fetched when
// the address asks for it.
import {element} from "./dom.js";
import {saveBlob} from "./picture.js";

const kFramesPerSecond = 60;

/// A row of the viewer: position, direction and up, the vertical angle in radians, orthographic height, width, height,
/// and the section's normal and offset.
function frameOf(row) {
  const frame = {
    position: row.slice(0, 3),
    direction: row.slice(3, 6),
    up: row.slice(6, 9),
    fov_y_degrees: row[9] * 180 / Math.PI,
    width: row[11],
    height: row[12]
  };
  if (row[10] > 0) frame.ortho_height = row[10];
  if (row.slice(13, 16).some(Boolean)) frame.section = {normal: row.slice(13, 16), offset: row[16]};
  return frame;
}

/// Makes a path with even times of what was seen: a list of {seconds, row}, of which each counts from its instant on.
function pathOf(seen, end) {
  const frames = [];
  for (let i = 0, at = 0;; ++i) {
    const now = seen[0].seconds + i / kFramesPerSecond;
    if (now > end) break;
    while (at + 1 < seen.length && seen[at + 1].seconds <= now) ++at;
    frames.push(frameOf(seen[at].row));
  }
  return {version: 1, frames_per_second: kFramesPerSecond, frames};
}

/// Records from the first picture on. `viewer`: window.lumigrid. Calls saved() with the file's name.
export function record(viewer, saved) {
  const seen = [];
  const button = element("button", {id: "record", type: "button", className: "plain", hidden: true});
  button.textContent = "● Save the recorded way";
  const look = (milliseconds) => {
    const row = viewer.firstPicture() && viewer.camera();
    if (row && `${row}` !== `${seen.at(-1)?.row}`) seen.push({seconds: milliseconds / 1000, row});
    button.hidden = seen.length === 0;
    requestAnimationFrame(look);
  };
  button.onclick = () => {
    const text = JSON.stringify(pathOf(seen, performance.now() / 1000));
    saveBlob(new Blob([text], {type: "application/json"}), "path.json");
    saved("path.json");
  };
  document.body.append(button);
  requestAnimationFrame(look);
}
