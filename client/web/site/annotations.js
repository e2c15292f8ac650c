// Loads the notes of the scene (docs/formats/annotations.md). The JSON is read here, and checked by the C++ client.
import {vector} from "./static_scene.js";

const kMaxBytes = 16 * 1024 * 1024;

function addCamera(core, camera) {
  const position = vector(camera?.position);
  const target = vector(camera?.target);
  const direction = vector(camera?.direction) ?? (position && target ? target.map((x, i) => x - position[i]) : null);
  const up = vector(camera?.up ?? [0, 0, 1]);
  const fov = camera?.fov_y_degrees ?? 45;
  if (!position || !direction || !up || typeof fov !== "number")
    return "camera: needs a position, and a direction or a target, of three numbers";
  return core.text("addAnnotationCamera", ...position, ...direction, ...up, (fov * Math.PI) / 180);
}

/// Adds one note to the client; returns the empty text, or what is wrong with it.
function add(core, one) {
  const position = vector(one?.position);
  if (!position || typeof one.title !== "string") return "needs a title and a position of three numbers";
  const normal = vector(one.normal ?? [0, 0, 0]);
  const text = one.text ?? "";
  if (!normal || typeof text !== "string") return "has a normal that is not three numbers, or a text that is none";
  return core.text("addAnnotation", one.title, text, ...position, ...normal) ||
      (one.camera === undefined ? "" : addCamera(core, one.camera));
}

async function read(url) {
  let answer;
  try {
    answer = await fetch(url, {cache: "no-cache"});
  } catch (error) {
    // Hosts that let other pages read a file may not do so for one that does not exist.
    if (url.origin !== location.origin) return null;
    throw error;
  }
  if (answer.status === 404) return null;
  if (!answer.ok) throw new Error(`the host answered ${answer.status}`);
  if (Number(answer.headers.get("Content-Length") ?? 0) > kMaxBytes) throw new Error("it is larger than 16 MiB");
  const document = await answer.json();
  if (document?.version !== 1 || !Array.isArray(document.annotations)) throw new Error("it is not of version 1");
  return document.annotations;
}

/// Loads the notes into the client and into `shown`. A file that breaks a rule is refused as a whole, with a message.
export async function loadAnnotations(url, core, shown, say) {
  try {
    const notes = await read(url);
    if (!notes) return;
    core.call("dropAnnotations");
    notes.forEach((note, i) => {
      const wrong = add(core, note);
      if (wrong) throw new Error(`note ${i}: ${wrong}`);
    });
    core.call("setAnnotations");
    shown.push(...notes.map(({title, text = ""}) => ({title, text})));
  } catch (error) {
    say(`no notes: annotations.json: ${error.message}`);
  }
}
