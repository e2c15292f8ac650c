// Helpers that the browser tests share: scenes, servers, Chromium, pictures. Everything runs on loopback ports that the
// system picks and in a folder of its own that is removed at the end, and is stopped by process id.
import {execFileSync, spawn} from "node:child_process";
import {existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync} from "node:fs";
import {connect, createServer} from "node:net";
import {tmpdir} from "node:os";
import {join} from "node:path";
import {chromium} from "playwright-core";
import {PNG} from "pngjs";

/// CMake sets these: the folders of the built programs and of the built page.
export const bin = process.env.LUMIGRID_BIN;
export const site = process.env.LUMIGRID_SITE;
for (const [name, value] of Object.entries({LUMIGRID_BIN: bin, LUMIGRID_SITE: site}))
  if (!value || !existsSync(value)) throw new Error(`set ${name} to a folder that is there (now: ${value})`);

const cleanups = [];
/// Runs `undo` when the test program ends, in reverse order.
export function atEnd(undo) { cleanups.push(undo); }
export async function cleanUp() {
  while (cleanups.length) await cleanups.pop()();
}

export const folder = mkdtempSync(join(tmpdir(), "lumigrid-web-"));
atEnd(() => rmSync(folder, {recursive: true, force: true}));

export function run(program, args) {
  return execFileSync(join(bin, program), args, {encoding: "utf8", stdio: ["ignore", "pipe", "pipe"]});
}

/// Makes a generated mesh, and a scene of it, each once per test program.
export function sampleMesh({shape = "statue", triangles = 60000} = {}) {
  const mesh = join(folder, `${shape}-${triangles}.ply`);
  if (!existsSync(mesh)) run("lumigrid", ["sample", "--shape", shape, "--triangles", String(triangles), "-o", mesh]);
  return mesh;
}
export function sampleScene({shape = "statue", triangles = 60000, grid = 3, face = 256} = {}) {
  const scene = join(folder, `${shape}-${triangles}-${grid}.scene`);
  if (existsSync(scene)) return scene;
  run("lumigrid",
      ["build", sampleMesh({shape, triangles}), "-o", scene, "--grid", String(grid), "--face", String(face)]);
  return scene;
}

export function freePort() {
  return new Promise((done) => {
    const probe = createServer().listen(0, "127.0.0.1", () => {
      const {port} = probe.address();
      probe.close(() => done(port));
    });
  });
}

function stop(child) {
  if (child.exitCode !== null || child.signalCode !== null) return;
  return new Promise((done) => {
    child.once("exit", done);
    child.kill("SIGCONT");
    child.kill("SIGTERM");
  });
}

/// Starts `lumigrid serve` with the page. Returns {url, port, stop()}.
export async function serve(scene, {port = 0, args = []} = {}) {
  const child = spawn(
      join(bin, "lumigrid"), ["serve", scene, "--port", String(port), "--json", "--web", site, ...args],
      {stdio: ["ignore", "pipe", "pipe"]});
  let said = "";
  let logged = "";
  child.stderr.on("data", (text) => (logged += text));
  const url = await new Promise((done, fail) => {
    child.once("exit", (code) => fail(new Error(`lumigrid serve ended with ${code}: ${logged}`)));
    child.stdout.on("data", (text) => {
      said += text;
      const found = /"url":\s*"([^"]+)"/.exec(said);
      if (found) done(found[1].replace(/^ws/, "http"));
    });
  });
  const server = {
    url,
    port: Number(new URL(url).port),
    stop: () => stop(child),
    log: () => logged,
    pause: () => child.kill("SIGSTOP"),
    resume: () => child.kill("SIGCONT")
  };
  atEnd(server.stop);
  return server;
}

/// Starts nginx over `root`; `lines` go into its location. Returns {url, stop(), requests()}; requests() returns those
/// since its last call, {method, uri, status, bytes, range}.
export async function nginx(root, lines = "") {
  const port = await freePort();
  const home = mkdtempSync(join(folder, "nginx-"));
  mkdirSync(join(home, "temp"));
  const temp = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
                   .map((kind) => `${kind}_temp_path ${home}/temp/${kind};`)
                   .join(" ");
  writeFileSync(
      join(home, "nginx.conf"),
      `pid ${home}/pid; error_log ${home}/error.log; daemon off; master_process off; worker_processes 1;
     events { worker_connections 256; }
     http { ${temp} include /etc/nginx/mime.types; types { application/wasm wasm; text/javascript mjs; }
       log_format plain '$request_method\t$uri\t$status\t$body_bytes_sent\t$http_range'; access_log ${
          home}/access.log plain;
       server { listen 127.0.0.1:${port}; location / { root ${root}; ${lines} } } }`,
  );
  const child =
      spawn("/usr/sbin/nginx", ["-e", `${home}/error.log`, "-p", home, "-c", `${home}/nginx.conf`], {stdio: "ignore"});
  const url = `http://127.0.0.1:${port}/`;
  for (let i = 0;; ++i) {
    if (child.exitCode !== null) throw new Error(`nginx did not start: ${readFileSync(`${home}/error.log`, "utf8")}`);
    try {
      await fetch(url);
      break;
    } catch (error) {
      if (i === 100) throw error;
      await new Promise((done) => setTimeout(done, 50));
    }
  }
  let seen = 0;
  const requests = () => {
    const lines = readFileSync(`${home}/access.log`, "utf8").trim().split("\n").filter(Boolean);
    const fresh = lines.slice(seen);
    seen = lines.length;
    return fresh.map((line) => {
      const [method, uri, status, bytes, range] = line.split("\t");
      return {method, uri, status: Number(status), bytes: Number(bytes), range: range === "-" ? "" : range};
    });
  };
  requests();
  const server = {url, stop: () => stop(child), requests};
  atEnd(server.stop);
  return server;
}

/// Returns the ranges of requests() as [name, first, last].
export const ranges = (requests) =>
    requests.filter(({range}) => range).map(({uri, range}) => [uri, ...range.match(/\d+/g).map(Number)]);

/// Returns the number of bytes that were requested more than once, less those of answers that Chromium lost: where an
/// interface of the machine comes or goes, it drops all that is under way (ERR_NETWORK_CHANGED). The page asks again.
export function repeated(requests, page) {
  let twice = -page.lost;
  const seen = new Map();
  for (const [uri, first, last] of ranges(requests)) {
    const had = seen.get(uri) ?? [];
    for (const [from, to] of had) twice += Math.max(0, Math.min(to, last) - Math.max(from, first) + 1);
    seen.set(uri, [...had, [first, last]]);
  }
  return Math.max(twice, 0);
}

/// Puts a link in front of a server: towards the page it has at most `bytesPerSecond` and delays each byte by `latency`
/// seconds, so once per round trip. Returns {url}.
export async function slowLink(port, bytesPerSecond, latency) {
  // All connections share one budget, as on a real link.
  let free = 0;
  const proxy = createServer((client) => {
    const upstream = connect(port, "127.0.0.1");
    client.pipe(upstream);
    let under = 0;
    upstream.on("data", (bytes) => {
      const now = performance.now() / 1000;
      free = Math.max(free, now) + bytes.length / bytesPerSecond;
      if (++under > 4) upstream.pause();
      setTimeout(() => {
        if (!client.destroyed) client.write(bytes);
        if (--under <= 4) upstream.resume();
      }, 1000 * (free - now + latency));
    });
    const end = () => (client.destroy(), upstream.destroy());
    for (const socket of [client, upstream]) socket.on("close", end).on("error", end);
  });
  await new Promise((done) => proxy.listen(0, "127.0.0.1", done));
  atEnd(() => proxy.close());
  return {url: `http://127.0.0.1:${proxy.address().port}/`};
}

const kBaseFlags = [
  "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
  "--disable-sync"
];
const kGl = {
  mesa: ["--use-gl=angle", "--use-angle=gl-egl", "--ignore-gpu-blocklist"],
  swiftshader: ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
};

/// Starts Chromium on Mesa's llvmpipe or on SwiftShader.
export async function launch(gl = "mesa", flags = []) {
  const browser =
      await chromium.launch({executablePath: "/usr/bin/chromium", args: [...kBaseFlags, ...kGl[gl], ...flags]});
  atEnd(() => browser.close());
  return browser;
}

const kNetworkChanged = /net::ERR_NETWORK_CHANGED/;

/// A new page of the context that collects its errors and warnings in page.faults, and in page.lost the bytes that it
/// asked for when the network of this machine changed.
export async function newPage(context) {
  const page = await context.newPage();
  page.faults = [];
  page.lost = 0;
  page.on("requestfailed", (request) => {
    const range = /bytes=(\d+)-(\d+)/.exec(request.headers().range);
    if (range && kNetworkChanged.test(request.failure()?.errorText)) page.lost += Number(range[2]) - range[1] + 1;
  });
  page.on("pageerror", (error) => page.faults.push(error.message));
  page.on("console", (message) => {
    if (["error", "warning"].includes(message.type()) && !kNetworkChanged.test(message.text()))
      page.faults.push(message.text());
  });
  return page;
}

/// Opens a page on `url`, in a context of its own.
export async function open(browser, url, options = {}) {
  const context = await browser.newContext({viewport: {width: 640, height: 360}, colorScheme: "light", ...options});
  const page = await newPage(context);
  await page.goto(url);
  return page;
}

export const figures = (page) => page.evaluate(() => window.lumigrid?.figures());
export const camera = (page) => page.evaluate(() => window.lumigrid.camera());
export const overlay = (page) => page.evaluate(() => window.lumigrid.overlay());

/// Waits until `wanted()` holds. Playwright's own waitForFunction is forbidden by the page's policy.
export async function until(wanted, what, milliseconds = 20000) {
  const end = Date.now() + milliseconds;
  while (!(await wanted())) {
    if (Date.now() > end) throw new Error(`waited ${milliseconds / 1000} s in vain for ${what}`);
    await new Promise((done) => setTimeout(done, 50));
  }
}

/// Waits until `wanted` holds for the figures; the error contains the last ones.
export async function waitFor(page, wanted, what, milliseconds = 60000) {
  const end = Date.now() + milliseconds;
  for (;;) {
    const now = await figures(page);
    if (now && (await wanted(now))) return now;
    if (Date.now() > end) {
      const text = await page.evaluate(() => document.body.innerText);
      throw new Error(
          `${what}: not within ${milliseconds / 1000} s at ${page.url()}; ${JSON.stringify(now)}; faults: ${
              page.faults.join("; ")}; the page says: ${text.slice(0, 400)}`);
    }
    await page.waitForTimeout(50);
  }
}

/// Waits until everything for this view is here, drawn and at rest.
export const settled = (page) => waitFor(page, (now) => now.complete === 1 && now.triangles > 0, "a complete picture");

/// Waits until the page has settled and images of little use are on the GPU as well, as in any client that has had
/// time.
export async function allHere(page) {
  await settled(page);
  let last = "";
  let same = 0;
  await until(async () => {
    await page.waitForTimeout(100);
    const {imagesResident, receivedBytes, complete, patches} = await figures(page);
    const now = [imagesResident, receivedBytes, complete, patches].join();
    // On a slow machine the last picture takes seconds.
    same = complete === 1 && now === last ? same + 1 : 0;
    last = now;
    return same === 6;
  }, "the images to come to rest");
}

/// Waits until there is a camera that is the same three times in a row, since a flight may begin with the next frame.
/// Returns the camera.
export async function still(page) {
  let last = await camera(page);
  let same = 0;
  await until(async () => {
    await page.waitForTimeout(70);
    const now = await camera(page);
    same = now && last && now.every((x, k) => x === last[k]) ? same + 1 : 0;
    last = now;
    return same === 3;
  }, "the camera to come to rest");
  return last;
}

/// Returns the canvas alone, RGBA, transparent where nothing is drawn.
export async function canvasPicture(page) {
  const data = await page.evaluate(() => window.lumigrid.picture());
  return PNG.sync.read(Buffer.from(data.split(",")[1], "base64"));
}

export function readPicture(file) { return PNG.sync.read(readFileSync(file)); }

/// Returns the native client's pictures of the same views. Each view is drawn several times, so that everything has
/// arrived in the last one. `cameras` are as camera() returns them.
export function nativePictures(url, cameras, extra = []) {
  const name = join(folder, `native-${cleanups.length}-${Date.now()}`);
  const looks = 4;
  const frames = cameras.flatMap((one) => Array(looks).fill(one))
                     .map(([px, py, pz, dx, dy, dz, ux, uy, uz, fov, , width, height]) => ({
                            position: [px, py, pz],
                            direction: [dx, dy, dz],
                            up: [ux, uy, uz],
                            fov_y_degrees: (fov * 180) / Math.PI,
                            width,
                            height,
                          }));
  writeFileSync(`${name}.json`, JSON.stringify({frames}));
  run("lumigrid-view", [url.replace(/^http/, "ws"), "--headless", "--path", `${name}.json`, "--out", name, ...extra]);
  return cameras.map((_, i) => readPicture(join(name, `frame_${String(looks * i + looks - 1).padStart(4, "0")}.png`)));
}

/// Compares two pictures over the pixels that show the model in either. Returns `mean`: mean of the largest channel's
/// difference, levels; `max`: the largest difference; `outliers`: share of the picture that differs by more than 8
/// levels; `covered`: share that shows the model.
export function difference(a, b) {
  if (a.width !== b.width || a.height !== b.height)
    throw new Error(`pictures of ${a.width} x ${a.height} and ${b.width} x ${b.height}`);
  let sum = 0, max = 0, outliers = 0, pixels = 0;
  for (let i = 0; i < a.data.length; i += 4) {
    if (a.data[i + 3] === 0 && b.data[i + 3] === 0) continue;
    let largest = 0;
    for (let c = 0; c < 4; ++c) largest = Math.max(largest, Math.abs(a.data[i + c] - b.data[i + c]));
    ++pixels;
    sum += largest;
    max = Math.max(max, largest);
    if (largest > 8) ++outliers;
  }
  const everywhere = a.data.length / 4;
  return {mean: pixels ? sum / pixels : 0, max, outliers: outliers / everywhere, covered: pixels / everywhere};
}
