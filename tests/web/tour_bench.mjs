// Measures whether the memory budget holds over a long tour, on a phone's budget:
//   LUMIGRID_BIN=build/release/bin LUMIGRID_SITE=build/web/site \
//     node tests/web/tour_bench.mjs SCENE [--minutes 10] [--published] [--csv FILE]
// SCENE is served by `lumigrid serve`, or with --published (then it is what `lumigrid publish` wrote) by nginx alone.
// The exit status is 1 when the budget was exceeded or something grew from the second lap to the last.
import {writeFileSync} from "node:fs";
import {parseArgs} from "node:util";

import {cleanUp, launch, nginx, serve, settled, site} from "./lib.mjs";
import {openCounted, phone, summary, tour} from "./tour.mjs";

const {values, positionals} = parseArgs({
  allowPositionals: true,
  options:
      {minutes: {type: "string", default: "10"}, published: {type: "boolean", default: false}, csv: {type: "string"}}
});
if (positionals.length !== 1)
  throw new Error("usage: node tour_bench.mjs SCENE [--minutes 10] [--published] [--csv FILE]");

async function address(scene) {
  if (!values.published) return (await serve(scene, {args: ["--no-frames"]})).url;
  const pages = await nginx(site, `location /scene/ { alias ${scene.replace(/\/*$/, "/")}; }`);
  return `${pages.url}?scene=scene/`;
}

try {
  const page = await openCounted(await launch(), await address(positionals[0]), phone);
  await settled(page);
  const toured = await tour(page, {seconds: 60 * Number(values.minutes)});
  if (values.csv)
    writeFileSync(values.csv, [
      "seconds,gl,gpu,memory,budget,wasm,heap,triangles", ...toured.samples.map((one) => Object.values(one).join())
    ].join("\n") + "\n");
  const found = summary(toured);
  const mb = (bytes) => (bytes / 1e6).toFixed(1);
  const percent = (share) => (100 * share).toFixed(1);
  console.log(
      `${found.laps} laps in ${found.seconds.toFixed(0)} s, ${found.samples} looks; budget ${mb(found.budget)} MB`);
  console.log(
      `most at a look: all that grows with the scene ${mb(found.most_memory)} MB, of it GL textures and buffers ${
          mb(found.most_gl)} MB (our count differs by ${found.most_miscount} bytes); WebAssembly's memory ${
          mb(found.most_wasm)} MB, JavaScript's heap ${mb(found.most_heap)} MB`);
  console.log(`from the second lap's end to the last's: GL ${percent(found.growth_gl)} %, WebAssembly's memory ${
      percent(found.growth_wasm)} %, JavaScript's heap ${percent(found.growth_heap)} %`);
  if (page.faults.length) console.log(`faults: ${page.faults.join("; ")}`);
  const held = found.most_memory <= found.budget && found.growth_wasm <= 0.05 && found.growth_heap <= 0.2 &&
      found.most_miscount === 0;
  process.exitCode = held && page.faults.length === 0 ? 0 : 1;
} finally {
  await cleanUp();
}
