// Measures the requests of a tour of a published scene to a plain web server, view by view:
//   LUMIGRID_BIN=build/release/bin LUMIGRID_SITE=build/web/site node tests/web/static_bench.mjs PUBLISHED [--json]
// nginx serves the page compressed and the scene as it is; then follows a tour of drags and zooms, each until it is
// complete and at rest, and the way back. The exit status is 1 when a byte was requested twice.
import {allHere, camera, cleanUp, launch, nginx, open, ranges, repeated, settled, site, still} from "./lib.mjs";

const published = process.argv[2];
if (!published) throw new Error("usage: node static_bench.mjs PUBLISHED [--json]");

const kinds = {
  ".lgp": "patches",
  ".lgr": "records",
  ".lgi": "index",
  ".lgk": "images",
  ".json": "scene"
};
const kindOf = (uri) => kinds[Object.keys(kinds).find((end) => uri.endsWith(end))] ?? "page";

try {
  const host = await nginx(site, `gzip_static on; location /scene/ { alias ${published.replace(/\/*$/, "/")}; }`);
  const page = await open(await launch(), `${host.url}?scene=scene/`, {viewport: {width: 1280, height: 720}});
  const all = [];
  const views = [];
  const note = async (name) => {
    await still(page);
    await allHere(page);
    const requests = host.requests();
    all.push(...requests);
    const bytes = {};
    for (const {uri, bytes: size} of requests) bytes[kindOf(uri)] = (bytes[kindOf(uri)] ?? 0) + size;
    views.push(
        {name, requests: requests.length, bytes: requests.reduce((sum, one) => sum + one.bytes, 0), kinds: bytes});
  };
  const drag = async (dx, dy, button = "left") => {
    await page.mouse.move(640, 360);
    await page.mouse.down({button});
    await page.mouse.move(640 + dx, 360 + dy, {steps: 4});
    await page.mouse.up({button});
  };
  await settled(page);
  await note("first view");
  const steps = [
    ["a quarter turn", () => drag(320, 0)],
    ["lower", () => drag(0, -120)],
    ["nearer", () => page.mouse.wheel(0, -500)],
    ["nearer", () => page.mouse.wheel(0, -500)],
    ["along", () => drag(-300, 60, "right")],
    ["nearer", () => page.mouse.wheel(0, -400)],
    ["a turn", () => drag(200, 20)],
    ["out", () => page.mouse.wheel(0, 1400)],
    ["back to the first view", () => page.keyboard.press("Home")],
  ];
  for (const [name, act] of steps) {
    await page.locator("#view").focus();
    await act();
    await note(name);
  }
  const twice = repeated(all, page);
  if (process.argv.includes("--json"))
    console.log(JSON.stringify({views, twice, camera: await camera(page)}));
  else {
    for (const {name, requests, bytes, kinds: list} of views)
      console.log(`${name}: ${requests} requests, ${bytes} bytes${
          requests ? ` (${Object.entries(list).map(([kind, size]) => `${kind} ${size}`).join(", ")})` : ""}`);
    console.log(`${all.length} requests, of them ${ranges(all).length} ranges; ${twice} bytes asked for twice`);
  }
  process.exitCode = twice === 0 ? 0 : 1;
} finally {
  await cleanUp();
}
