// Opens a published scene on a static host. scene.json is read here (docs/formats/scene.md), everything else by the C++
// client through byte ranges.
import {kBytes, makeRanges} from "./ranges.js";

const kMaxBytes = 16_000_000;

/// Methods that stream a file of their own: its stem and extension, and what they draw.
const kStreamed = [
  ["qsplat", ".lgq", "splats"], ["pmr", ".lgm", "points and umbrellas"], ["hlod", ".lgh", "triangles and points"]
];

/// An error with advice for the user.
class SceneError extends Error {
  constructor(title, advice) {
    super(title);
    this.advice = advice;
  }
}

/// Thrown where a scene lacks what is to be shown, but has what `method` shows.
export class OtherMethod extends SceneError {
  constructor(method, title, advice) {
    super(title, advice);
    this.method = method;
  }
}

async function readJson(url) {
  let answer;
  try {
    answer = await fetch(url, {cache: "no-cache"});
  } catch {
    throw new SceneError(
        `${url} cannot be read`,
        "There is no such host, no network, or the host does not let pages from elsewhere read it: it must send " +
            "Access-Control-Allow-Origin (docs/hosting.md).");
  }
  if (answer.status === 404)
    throw new SceneError(
        "There is no scene here",
        `${url} is not there. Check the address; it must name a folder that lumigrid publish wrote.`);
  if (!answer.ok)
    throw new SceneError(`${url}: the host answered ${answer.status}`, "Check the address and who may read it.");
  if (Number(answer.headers.get("Content-Length") ?? 0) > kMaxBytes)
    throw new SceneError(`${url} is no scene`, "The file is too large for one.");
  try {
    return await answer.json();
  } catch {
    throw new SceneError(`${url} is no scene`, "It holds no JSON. Publish the scene again with lumigrid publish.");
  }
}

/// Returns the value if it is three numbers, else null.
export const vector = (value) =>
    (Array.isArray(value) && value.length === 3 && value.every(Number.isFinite) ? value : null);

/// Returns the published part whose name begins and ends so; null when there is none.
export function partOf(parts, front, end) {
  const part = parts.find(({file}) => typeof file === "string" && file.startsWith(front) && file.endsWith(end));
  return part && /-[0-9a-f]{32}\./.test(part.file) && Number.isSafeInteger(part.bytes) && part.bytes > 0 ? part : null;
}

/// Names a scene by its title, or the last part of its address; where there is none, by its source: "tower" from
/// "/scans/tower.ply".
function nameOf(base, scene) {
  if (typeof scene.title === "string" && scene.title) return scene.title;
  const {pathname, host} = new URL(base);
  const folder = pathname.split("/").filter(Boolean).at(-1);
  if (folder) return decodeURIComponent(folder);
  const source = String(scene.sources?.[0]?.path ?? "").split("/").at(-1);
  return source.replace(/\.[^.]*$/, "") || host;
}

/// Returns how surfaces are shaded, as client/web/page.h numbers it.
const shadingOf = (light) => light?.mode === "unlit" ? 1 : String(light?.mode).endsWith("-shadows") ? 2 : 0;

/// Returns "#rrggbb" as a number, -1 for anything else.
const colorOf = (text) => (/^#[0-9a-f]{6}$/i.test(text) ? parseInt(text.slice(1), 16) : -1);

/// Reads scene.json. `base`: URL of its folder. Returns {url, scene, parts, numbers, hull}, with the numbers and the
/// hull's points in the order of client/web/page.h. Throws SceneError.
export async function readScene(base) {
  const url = new URL("scene.json", base).href;
  const scene = await readJson(url);
  if (scene?.version !== 1)
    throw new SceneError(
        `${url} is no scene that this viewer knows`,
        "Its version is not 1; publish the scene again, or update the viewer.");
  const vectors =
      [
        scene.origin, scene.box_min, scene.box_max, scene.up, scene.light?.direction ?? [0, 0, 1],
        scene.start_direction ?? [0, 0, 0]
      ].map(vector);
  if (vectors.includes(null))
    throw new SceneError(
        `${url} is damaged`, "Origin, box, up or light is not three numbers; publish the scene again.");
  const start = vectors.pop();
  const light = vectors.pop();
  const hull = [scene.hull ?? []].flat().map(vector);
  if (hull.includes(null) || hull.length > 32)
    throw new SceneError(`${url} is damaged`, "Its hull is no list of points; publish the scene again.");
  return {
    url,
    scene,
    parts: Array.isArray(scene.parts) ? scene.parts : [],
    numbers: [
      ...vectors.flat(), shadingOf(scene.light), ...light, ...start, colorOf(scene.background),
      Number.isFinite(scene.north) ? scene.north : NaN, hull.length
    ],
    hull
  };
}

/// Hands the scene to the client's function `name`, which gets place, scene's name, units, first view, attribution, the
/// names of the parts' files, and all numbers: those of the scene, the parts' lengths, `more`, the hull's and `last`.
/// Returns a function of `now` that is to be called each turn, and returns true when something arrived.
function openParts(name, base, {scene, numbers, hull}, core, changed, parts, more = [], last = []) {
  const ranges = makeRanges(base, (job, outcome, status, bytes, detail) => {
    if (outcome === kBytes)
      core.fill(core.call("fetchedBytes", job, status, bytes.length), bytes);
    else
      core.call("fetchFailed", job, outcome, status, detail);
    changed();
  });
  core.fetchRange = ranges.fetch;
  core.cancelRange = ranges.cancel;
  core.withNumbers(
      [...numbers, ...parts.map((part) => part?.bytes ?? 0), ...more, ...hull.flat(), ...last],
      (at) => core.call(
          name, base.replace(/\/$/, ""), nameOf(base, scene), String(scene.units ?? ""), String(scene.start_view ?? ""),
          String(scene.attribution ?? ""), ...parts.map((part) => part?.file ?? ""), at));
  return (now) => core.call("pumpStatic", now) !== 0;
}

/// Returns the part of a streamed method. A scene of our server has it under its plain name.
function streamedPart(parts, stem, extension) {
  const plain =
      parts.find(({file, bytes}) => file === stem + extension && Number.isSafeInteger(bytes) && bytes > 0);
  return partOf(parts, `${stem}-`, extension) ?? plain;
}

/// Opens the file of a streamed method, as openStaticScene does patches. `reading`: what readScene() returned.
export async function openStreamedScene(method, base, reading, core, changed) {
  const read = await reading;
  const {url, parts} = read;
  const [stem, extension, content] = kStreamed.find(([name]) => name === method);
  const part = streamedPart(parts, stem, extension);
  const saves = navigator.connection?.saveData ? 1 : 0;
  if (part) return openParts("openStreamed", base, read, core, changed, [part], [saves, 0]);
  const title = `${url} lists no ${content}`;
  const advice = `Build them with lumigrid build ... --methods ${method}, and publish the scene again.`;
  const hasPatches = parts.some(({file}) => /^patch.*\.lgp$/.test(file));
  const other = hasPatches ? "lumigraph" : kStreamed.find(([stem, end]) => streamedPart(parts, stem, end))?.[0];
  throw other ? new OtherMethod(other, title, advice) : new SceneError(title, advice);
}

/// Returns offsets and lengths of the ranges that a part names to be read first; none where one of them cannot be.
function openingOf(part) {
  const numbers = [part.opening ?? []].flat(2);
  return numbers.length % 2 === 0 && numbers.every((n) => Number.isSafeInteger(n) && n >= 0) ? numbers : [];
}

/// Hands the scene to the client and returns what openParts() does. `base`: URL of its folder. Throws SceneError.
export async function openStaticScene(base, core, changed) {
  const read = await readScene(base);
  const {url, parts} = read;
  const patches = partOf(parts, "patch-", ".lgp");
  const other = kStreamed.find(([stem, extension]) => partOf(parts, `${stem}-`, extension));
  if (!patches && other) throw new OtherMethod(other[0], `${url} lists no patches`);
  if (!patches)
    throw new SceneError(
        `${url} is not published`, "Its parts have no names by content; put there what lumigrid publish wrote.");
  const index = partOf(parts, "images/index-", ".lgi");
  const records = partOf(parts, "records-", ".lgr");
  if (!records)
    throw new SceneError(
        `${url} lists no records of groups`, "An earlier program published it; publish the scene again.");
  const openings = [patches, records, index ?? {}]
      .map(openingOf).flatMap((opening) => [opening.length / 2, ...opening]);
  return openParts("openStatic", base, read, core, changed, [patches, records, index], [], openings);
}

/// Reads the parameters of an image index (docs/formats/repository.md): numbers and the tree's digits; null when they
/// hold no grid.
export function parametersOf(text) {
  let root;
  try {
    root = JSON.parse(text);
  } catch {
    return null;
  }
  const grid = root?.grid;
  const first = vector(grid?.first);
  const count = vector(grid?.count);
  if (!first || !count || !Number.isFinite(grid.spacing) || !Number.isFinite(grid.face_size)) return null;
  if (root.tree !== undefined && typeof root.tree !== "string") return null;
  return {numbers: [...first, grid.spacing, ...count, grid.face_size, grid.tile_depth ?? 0], tree: root.tree ?? ""};
}
