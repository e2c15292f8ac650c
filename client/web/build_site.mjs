// Builds the page: node build_site.mjs SITE_SOURCES BUILT_FILES OUT
// esbuild bundles the scripts. Every file but index.html is named by its content, so that it can be kept for ever, and
// is written once more as .gz and .br.
import {execFileSync} from "node:child_process";
import {createHash} from "node:crypto";
import {copyFileSync, mkdirSync, mkdtempSync, readdirSync, readFileSync, rmSync, writeFileSync} from "node:fs";
import {tmpdir} from "node:os";
import {basename, extname, join} from "node:path";
import {brotliCompressSync, constants, gzipSync} from "node:zlib";

const [sources, built, out] = process.argv.slice(2);
if (!out) throw new Error("usage: node build_site.mjs SITE_SOURCES BUILT_FILES OUT");
const work = mkdtempSync(join(tmpdir(), "lumigrid-site-"));
mkdirSync(out, {recursive: true});
for (const old of readdirSync(out)) rmSync(join(out, old));

function writeHashed(name, bytes, {fixed = false} = {}) {
  const hash = createHash("sha256").update(bytes).digest("hex").slice(0, 12);
  const place = fixed ? name : `${basename(name, extname(name))}-${hash}${extname(name)}`;
  writeFileSync(join(out, place), bytes);
  writeFileSync(join(out, place + ".gz"), gzipSync(bytes, {level: 9}));
  writeFileSync(join(out, place + ".br"), brotliCompressSync(bytes, {
                  params: {[constants.BROTLI_PARAM_QUALITY]: 11, [constants.BROTLI_PARAM_SIZE_HINT]: bytes.length}
                }));
  return place;
}

function bundle(entry, defines = {}) {
  const result = join(work, basename(entry));
  execFileSync(
      "esbuild",
      [
        join(sources, entry), "--bundle", "--minify", "--format=esm", "--target=es2020,safari14", "--log-level=warning",
        "--legal-comments=none", `--outfile=${result}`,
        ...Object.entries(defines).map(([name, value]) => `--define:${name}=${JSON.stringify(value)}`)
      ],
      {stdio: ["ignore", "inherit", "inherit"], env: {...process.env, NODE_PATH: built}},
  );
  return readFileSync(result);
}

/// Runs Binaryen once more until nothing gets smaller: 2 % that the compiler's own pass leaves.
function shrink(name) {
  const out = join(work, name);
  execFileSync("wasm-opt", [
    "-Oz", "--converge", "--enable-simd", "--enable-mutable-globals", "--enable-nontrapping-float-to-int",
    "--enable-sign-ext", "--enable-bulk-memory", "--zero-filled-memory", join(built, name), "-o", out
  ]);
  return readFileSync(out);
}

const viewerWasm = writeHashed("viewer.wasm", shrink("client_web.wasm"));
const splatsWasm = writeHashed("splats.wasm", shrink("client_web_splats.wasm"));
const splats = writeHashed("splats.js", bundle("splats.js"));
const umbrellasWasm = writeHashed("umbrellas.wasm", shrink("client_web_umbrellas.wasm"));
const umbrellas = writeHashed("umbrellas.js", bundle("umbrellas.js"));
const hlodWasm = writeHashed("hlod.wasm", shrink("client_web_hlod.wasm"));
const hlod = writeHashed("hlod.js", bundle("hlod.js"));
const decodeWasm = writeHashed("decode.wasm", shrink("client_web_decode.wasm"));
const worker = writeHashed("decode.js", bundle("decode_worker.js"));
const checkWasm = writeHashed("check.wasm", shrink("client_web_check.wasm"));
const check = writeHashed("check.js", bundle("check.js", {CHECK_WASM: checkWasm}));
const record = writeHashed("record.js", bundle("record.js"));
const names = {
  VIEWER_WASM: viewerWasm,
  SPLATS_WASM: splatsWasm,
  SPLATS_SCRIPT: splats,
  UMBRELLAS_WASM: umbrellasWasm,
  UMBRELLAS_SCRIPT: umbrellas,
  HLOD_WASM: hlodWasm,
  HLOD_SCRIPT: hlod,
  DECODE_WASM: decodeWasm,
  DECODE_WORKER: worker,
  CHECK_SCRIPT: check,
  RECORD_SCRIPT: record,
};
const main = writeHashed("viewer.js", bundle("main.js", names));
const style = writeHashed("style.css", bundle("style.css"));
let html = readFileSync(join(sources, "index.html"), "utf8");
const references = {
  "main.js": main,
  "style.css": style,
  "viewer.wasm": viewerWasm,
  "splats.wasm": splatsWasm,
  "splats.js": splats,
  "umbrellas.wasm": umbrellasWasm,
  "umbrellas.js": umbrellas,
  "hlod.wasm": hlodWasm,
  "hlod.js": hlod,
};
for (const [from, to] of Object.entries(references)) {
  if (!html.includes(`"${from}"`)) throw new Error(`index.html does not name ${from}`);
  html = html.replaceAll(`"${from}"`, `"${to}"`);
}
// The script is inserted unchanged, since the page's policy names it by its hash (server/net/page_files.h).
html = html.replace(">EARLY<", () => `>${readFileSync(join(sources, "early.js"), "utf8")}<`);
writeHashed("index.html", Buffer.from(html), {fixed: true});
rmSync(work, {recursive: true});
