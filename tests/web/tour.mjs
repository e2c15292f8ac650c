// Makes a tour as a hand does, lap after lap of the same path, and records each second what the page holds: our own
// count, a second count at WebGL's calls that shares no code with it, the WebAssembly's memory, and the page's heap.
/// The properties of a browser on a phone.
export const phone = {
  viewport: {width: 390, height: 700},
  hasTouch: true,
  isMobile: true,
  deviceScaleFactor: 2
};

/// For addInitScript: counts the bytes of textures, buffers and renderbuffers at WebGL's calls, as window.glBytes().
/// Unknown formats and calls are listed by glUnknown().
export function countGl() {
  const kPixel = {RG8: 2, RGBA8UI: 4, R32UI: 4, RGBA32F: 16, RGBA8: 4, DEPTH_COMPONENT24: 4, DEPTH24_STENCIL8: 4,
                  RGBA32UI: 16};
  const gl = WebGL2RenderingContext.prototype;
  const pixelBytes = new Map(Object.entries(kPixel).map(([name, bytes]) => [WebGL2RenderingContext[name], bytes]));
  const bindings = new Map(
      Object
          .entries({
            TEXTURE_2D: "TEXTURE_BINDING_2D",
            TEXTURE_2D_ARRAY: "TEXTURE_BINDING_2D_ARRAY",
            RENDERBUFFER: "RENDERBUFFER_BINDING",
            ARRAY_BUFFER: "ARRAY_BUFFER_BINDING",
            ELEMENT_ARRAY_BUFFER: "ELEMENT_ARRAY_BUFFER_BINDING",
            UNIFORM_BUFFER: "UNIFORM_BUFFER_BINDING",
            PIXEL_UNPACK_BUFFER: "PIXEL_UNPACK_BUFFER_BINDING",
            PIXEL_PACK_BUFFER: "PIXEL_PACK_BUFFER_BINDING",
          })
          .map(([target, binding]) => [WebGL2RenderingContext[target], WebGL2RenderingContext[binding]]),
  );
  const held = new Map();
  const unknown = new Set();
  const set = (context, target, bytes) => {
    const binding = bindings.get(target);
    if (binding === undefined || !Number.isFinite(bytes)) return unknown.add(`target ${target}`);
    held.set(context.getParameter(binding), bytes);
  };
  const watch = (name, act) => {
    const plain = gl[name];
    gl[name] = function(...args) {
      act(this, ...args);
      return plain.apply(this, args);
    };
  };
  const bytesOf = (format) => pixelBytes.get(format) ?? (unknown.add(`format ${format}`), NaN);
  const pyramid = (levels, width, height, layers, format) => {
    let bytes = 0;
    for (let level = 0; level < levels; ++level)
      bytes += Math.max(1, width >> level) * Math.max(1, height >> level) * layers * bytesOf(format);
    return bytes;
  };
  watch(
      "texStorage2D",
      (context, target, levels, format, width, height) =>
          set(context, target, pyramid(levels, width, height, 1, format)));
  watch(
      "texStorage3D",
      (context, target, levels, format, width, height, layers) =>
          set(context, target, pyramid(levels, width, height, layers, format)));
  watch(
      "renderbufferStorage",
      (context, target, format, width, height) => set(context, target, width * height * bytesOf(format)));
  watch(
      "renderbufferStorageMultisample",
      (context, target, samples, format, width, height) =>
          set(context, target, Math.max(1, samples) * width * height * bytesOf(format)));
  watch(
      "bufferData",
      (context, target, data, usage, offset, length) =>
          set(context, target,
              typeof data === "number" ? data :
                  length               ? length * data.BYTES_PER_ELEMENT :
                                         data.byteLength));
  for (const name of ["texImage2D", "texImage3D", "copyTexImage2D"])
    watch(name, () => unknown.add(name));
  for (const name of ["deleteTexture", "deleteBuffer", "deleteRenderbuffer"])
    watch(name, (_, object) => held.delete(object));
  window.glBytes = () => [...held.values()].reduce((sum, bytes) => sum + bytes, 0);
  window.glUnknown = () => [...unknown];
}

/// Opens a page whose GL is counted.
export async function openCounted(browser, url, options) {
  const context = await browser.newContext({colorScheme: "light", ...options});
  const page = await context.newPage();
  page.faults = [];
  page.on("pageerror", (error) => page.faults.push(error.message));
  await page.addInitScript(countGl);
  await page.goto(url);
  return page;
}

/// Makes one lap: around the model, near and far, along it, and home. `between()` is called after each step.
async function lap(page, steps, between) {
  const {width, height} = page.viewportSize();
  const middle = [width / 2, height / 2];
  for (let i = 0; i < steps; ++i) {
    await page.mouse.move(...middle);
    const button = i % 5 === 4 ? "right" : "left";
    await page.mouse.down({button});
    await page.mouse.move(
        middle[0] + 0.28 * width * Math.cos(1.3 * i), middle[1] + 0.12 * height * Math.sin(1.7 * i), {steps: 3});
    await page.mouse.up({button});
    // Come nearer for half of the lap, then go back.
    await page.mouse.wheel(0, i % steps < steps / 2 ? -180 : 180);
    await between();
  }
  await page.locator("#view").press("Home");
  await between();
}

/// Tours for `seconds`, at least three laps of `steps`. Returns {samples: one a second, laps: one at the end of each
/// lap, after garbage collection}. A sample is {seconds, gl, gpu, memory, budget, wasm, heap, triangles}, in bytes.
export async function tour(page, {seconds, steps = 12, look = 1000}) {
  const cdp = await page.context().newCDPSession(page);
  const begin = performance.now();
  const elapsed = () => (performance.now() - begin) / 1000;
  const samples = [];
  const laps = [];
  const sample = async () => {
    const [now, gl, unknown] =
        await page.evaluate(() => [window.lumigrid.figures(), window.glBytes(), window.glUnknown()]);  // at one time
    if (unknown.length) throw new Error(`GL storage that is not counted: ${unknown.join()}`);
    const {usedSize} = await cdp.send("Runtime.getHeapUsage");
    const one = {
      seconds: elapsed(),
      gl,
      gpu: now.gpuBytes,
      memory: now.memoryBytes,
      budget: now.memoryBudget,
      wasm: now.wasmBytes,
      heap: usedSize,
      triangles: now.triangles
    };
    samples.push(one);
    return one;
  };
  let next = 0;
  while (elapsed() < seconds || laps.length < 3) {
    await lap(page, steps, async () => {
      if (1000 * elapsed() < next) return page.waitForTimeout(30);
      next = Math.max(next + look, 1000 * elapsed());
      await sample();
    });
    await page.waitForTimeout(1000);
    await cdp.send("HeapProfiler.collectGarbage");
    laps.push(await sample());
  }
  return {samples, laps};
}

/// Summarizes a tour; growth is from the end of the second lap to the last, as a share.
export function summary({samples, laps}) {
  const most = (name) => Math.max(...samples.map((one) => one[name]));
  const growth = (name) => laps.at(-1)[name] / laps[1][name] - 1;  // the first lap fills what is empty
  return {
    seconds: samples.at(-1).seconds,
    samples: samples.length,
    laps: laps.length,
    budget: samples[0].budget,
    most_memory: most("memory"),
    most_gl: most("gl"),
    most_miscount: Math.max(...samples.map(({gl, gpu}) => Math.abs(gl - gpu))),
    most_wasm: most("wasm"),
    most_heap: most("heap"),
    growth_gl: growth("gl"),
    growth_wasm: growth("wasm"),
    growth_heap: growth("heap")
  };
}
