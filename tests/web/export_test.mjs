// Tests of what `lumigrid export` writes by programs that are not ours: Khronos's validator of glTF, and
// 3DTilesRendererJS, which has to show the same picture as `lumigrid render`.
import assert from "node:assert/strict";
import {existsSync, readdirSync, readFileSync, writeFileSync} from "node:fs";
import {createServer} from "node:http";
import {join} from "node:path";
import {after, test} from "node:test";
import {fileURLToPath} from "node:url";
import {PNG} from "pngjs";

import {atEnd, cleanUp, folder, launch, open, readPicture, run, sampleMesh, until} from "./lib.mjs";

after(cleanUp);

const modules = fileURLToPath(new URL("node_modules/", import.meta.url));
/// The reason to skip a test that needs these packages, or false.
const without = (...names) => names.every((name) => existsSync(join(modules, name))) ?
    false :
    `no ${names.join(", ")}: npm ci --prefix tests/web`;

/// Builds a scene and exports it, each once. Returns their folders and one GLB of few triangles.
function exported(name) {
  const scene = join(folder, `${name}.scene`), tiles = join(folder, `${name}.tiles`), glb = join(folder, `${name}.glb`);
  if (existsSync(glb)) return {scene, tiles, glb};
  let mesh = join(folder, "facade.obj");
  if (name === "facade")
    run("lumigrid", ["sample", "--shape", "facade", "--triangles", "20000", "--texels", "100", "-o", mesh]);
  else
    mesh = sampleMesh({shape: "relief", triangles: 60000});
  run("lumigrid", ["build", mesh, "-o", scene, "--methods", "patch", "--quiet"]);
  run("lumigrid", ["export", scene, "--3dtiles", tiles, "--glb", glb, "--triangles", "10k", "--quiet"]);
  return {scene, tiles, glb};
}

for (const name of ["relief", "facade"])
  test(`each GLB of a ${name} is valid without a warning`, {skip: without("gltf-validator")}, async () => {
    const {default: validator} = await import("gltf-validator");
    const {tiles, glb} = exported(name);
    const files = readdirSync(tiles, {recursive: true}).filter((file) => file.endsWith(".glb"));
    assert.ok(files.length > 5);
    for (const file of [...files.map((file) => join(tiles, file)), glb]) {
      const {issues} = await validator.validateBytes(new Uint8Array(readFileSync(file)));
      assert.deepEqual([issues.numErrors, issues.numWarnings], [0, 0], `${file}: ${JSON.stringify(issues.messages)}`);
    }
  });

/// A page that loads a tileset and stops when all that the view needs is drawn.
const page = (camera, error) => `<!doctype html><link rel="icon" href="data:,">
<canvas id="canvas" width="${camera.width}" height="${camera.height}"></canvas>
<script type="importmap">{"imports": {
  "three": "/modules/three/build/three.module.js",
  "three/addons/": "/modules/three/examples/jsm/",
  "3d-tiles-renderer": "/modules/3d-tiles-renderer/build/index.three.js"}}</script>
<script type="module">
import {PerspectiveCamera, Scene, WebGLRenderer} from "three";
import {TilesRenderer} from "3d-tiles-renderer";
const view = ${JSON.stringify(camera)};
const canvas = document.getElementById("canvas");
const renderer = new WebGLRenderer({canvas, antialias: true, alpha: true, preserveDrawingBuffer: true});
renderer.setClearColor(0, 0);
const camera = new PerspectiveCamera(view.fov_y_degrees, view.width / view.height, 0.02, 1000);
camera.up.set(...view.up);
camera.position.set(...view.position);
camera.lookAt(...view.target);
camera.updateMatrixWorld();
const tiles = new TilesRenderer("/tiles/tileset.json");
tiles.errorTarget = ${error};
tiles.setCamera(camera);
tiles.setResolution(camera, view.width, view.height);
tiles.addEventListener("load-error", ({error}) => console.error(String(error)));
const scene = new Scene();
scene.add(tiles.group);
let rest = 0;
function draw() {
  tiles.update();
  renderer.render(scene, camera);
  const {downloading, parsing, queued} = tiles.stats;
  rest = tiles.root && downloading + parsing + queued === 0 ? rest + 1 : 0;
  window.triangles = rest > 20 ? renderer.info.render.triangles : 0;
  if (!window.triangles) requestAnimationFrame(draw);
}
draw();
</script>`;

/// Serves the page, a tileset and the packages.
async function serveTiles(tiles, html) {
  const types = {html: "text/html", js: "text/javascript", json: "application/json", glb: "model/gltf-binary"};
  const server = createServer((request, response) => {
    const [, place, rest] = /^\/(?:(tiles|modules)\/(.*))?/.exec(new URL(request.url, "http://x").pathname);
    const file = join(place === "tiles" ? tiles : modules, rest ?? "");
    const found = !place || existsSync(file);
    response.writeHead(found ? 200 : 404, {"Content-Type": types[place ? file.split(".").pop() : "html"] ?? ""});
    response.end(place ? found && readFileSync(file) : html);
  });
  await new Promise((done) => server.listen(0, "127.0.0.1", done));
  atEnd(() => server.close());
  return `http://127.0.0.1:${server.address().port}/`;
}

/// Compares the pixels that both cover by more than half, and counts those that only one does.
function compare(a, b) {
  let alone = 0, both = 0, sum = 0;
  for (let i = 0; i < a.data.length; i += 4) {
    const [in_a, in_b] = [a.data[i + 3] > 127, b.data[i + 3] > 127];
    if (in_a !== in_b) ++alone;
    if (!in_a || !in_b) continue;
    ++both;
    for (let c = 0; c < 3; ++c) sum += Math.abs(a.data[i + c] - b.data[i + c]) / 3;
  }
  const pixels = a.data.length / 4;
  return {alone: alone / pixels, covered: both / pixels, mean: sum / both};
}

// The relief is 2 x 1 in the plane z = 0, the facade 20 x 12 m likewise.
const views = {
  relief: {errors: [1, 20], view: {position: [0.6, -0.9, 1.6], target: [0, 0, 0], up: [0, 1, 0]}},
  facade: {errors: [1, 100], view: {position: [12, 5, 14], target: [10, 6, 0], up: [0, 1, 0]}},
};
for (const [name, {errors, view}] of Object.entries(views))
  for (const error of errors)
    test(`3DTilesRendererJS shows a ${name} as we do at ${error} pixels`,
         {skip: without("three", "3d-tiles-renderer")}, async () => {
           const {scene, tiles} = exported(name);
           const camera = {...view, fov_y_degrees: 50, width: 640, height: 360};
           const browser = await launch();
           const shown = await open(browser, await serveTiles(tiles, page(camera, error)));
           await until(() => shown.evaluate(() => window.triangles > 0), "the tiles");
           const data = await shown.evaluate(() => document.getElementById("canvas").toDataURL("image/png"));
           const picture = PNG.sync.read(Buffer.from(data.split(",")[1], "base64"));

           const file = join(folder, `${name}-${error}`);
           writeFileSync(`${file}.json`, JSON.stringify(camera));
           run("lumigrid",
               ["render", scene, "--camera", `${file}.json`, "--method", "patches", "--tolerance", String(error), "-o",
                `${file}.png`]);
           const apart = compare(picture, readPicture(`${file}.png`));
           console.log(`${name} at ${error} pixels: ${await shown.evaluate(() => window.triangles)} triangles, ${
               (100 * apart.alone).toFixed(3)} % of the pixels in one picture alone, mean ${
               apart.mean.toFixed(2)} levels`);
           assert.ok(apart.covered > 0.1, "there is nothing in the pictures");
           assert.ok(apart.alone < 0.001, `${apart.alone} of the pixels are in one picture alone`);
           // Coarser cuts are not the same: we measure distances to spheres, the tiles have boxes.
           assert.ok(error > 1 || apart.mean < 6, `the mean difference is ${apart.mean} levels`);
           // It warns of tilesets at version 1.1, of whose extensions ours has none.
           assert.deepEqual(shown.faults.filter((fault) => !fault.includes("versions at 1.1")), []);
         });
