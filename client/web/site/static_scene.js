// Opens a published scene on a static host. scene.json is read here (docs/formats/scene.md), everything else by the C++
// client through byte ranges.
import {kBytes, makeRanges} from "./ranges.js";

const kMaxBytes = 16_000_000;

/// Thrown by openStaticScene where a scene has splats and no patches: the viewer of splats shows it.
export class SplatsOnly extends Error {}

/// An error with advice for the user.
class SceneError extends Error {
  constructor(title, advice) {
    super(title);
    this.advice = advice;
  }
}

/// Thrown by openSplatScene where a scene has patches and no splats.
export class NoSplats extends SceneError {}

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

/// Returns "#rrggbb" as a number, -1 for anything else.
const colorOf = (text) => (/^#[0-9a-f]{6}$/i.test(text) ? parseInt(text.slice(1), 16) : -1);

/// Reads scene.json. `base`: URL of its folder. Returns {url, scene, parts, numbers}, with the numbers in the order of
/// client/web/page.h. Throws SceneError.
async function readScene(base) {
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
  return {
    url,
    scene,
    parts: Array.isArray(scene.parts) ? scene.parts : [],
    numbers: [
      ...vectors.flat(), scene.light?.mode === "unlit" ? 1 : 0, ...light, ...start, colorOf(scene.background),
      Number.isFinite(scene.north) ? scene.north : NaN
    ]
  };
}

/// Hands the scene to the client's function `name`, which gets place, scene's name, units, first view, attribution, the
/// names of the parts' files and all numbers. Returns a function of `now` that is to be called each turn, and returns
/// true when something arrived.
function openParts(name, base, {scene, numbers}, core, changed, parts) {
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
      [...numbers, ...parts.map((part) => part?.bytes ?? 0)],
      (at) => core.call(
          name, base.replace(/\/$/, ""), nameOf(base, scene), String(scene.units ?? ""), String(scene.start_view ?? ""),
          String(scene.attribution ?? ""), ...parts.map((part) => part?.file ?? ""), at));
  return (now) => core.call("pumpStatic", now) !== 0;
}

/// Opens the splats of a scene, as openStaticScene does its patches. A scene of our server has them under their plain
/// name.
export async function openSplatScene(base, core, changed) {
  const read = await readScene(base);
  const {url, parts} = read;
  const plain = parts.find(({file, bytes}) => file === "qsplat.lgq" && Number.isSafeInteger(bytes) && bytes > 0);
  const splats = partOf(parts, "qsplat-", ".lgq") ?? plain;
  const advice = "Build them with lumigrid build ... --methods qsplat, and publish the scene again.";
  if (!splats && parts.some(({file}) => /^patch.*\.lgp$/.test(file)))
    throw new NoSplats(`${url} lists no splats`, advice);
  if (!splats) throw new SceneError(`${url} lists no splats`, advice);
  return openParts("openSplats", base, read, core, changed, [splats]);
}

/// Hands the scene to the client and returns what openParts() does. `base`: URL of its folder. Throws SceneError or
/// SplatsOnly.
export async function openStaticScene(base, core, changed) {
  const read = await readScene(base);
  const {url, parts} = read;
  const patches = partOf(parts, "patch-", ".lgp");
  if (!patches && partOf(parts, "qsplat-", ".lgq")) throw new SplatsOnly();
  if (!patches)
    throw new SceneError(
        `${url} is not published`, "Its parts have no names by content; put there what lumigrid publish wrote.");
  return openParts("openStatic", base, read, core, changed, [patches, partOf(parts, "images/index-", ".lgi")]);
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
