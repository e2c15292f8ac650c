// Wraps the C++ client for JavaScript: takes text rows apart, and copies bytes in and out.
import createViewer from "client_web.js";

import {callsOf} from "./calls.js";
import {makeDecoder} from "./decode.js";
import {parametersOf} from "./static_scene.js";

/// `create` makes the WebAssembly module at files.viewerWasm; streamed methods have others.
export async function loadCore(files, create = createViewer) {
  let module;
  const decode = makeDecoder({worker: files.worker, wasm: files.decodeWasm}, (low, high, image, error) => {
    if (image)
      fill(module._decodedPixels(low, high, image.width, image.height), image.rgba);
    else
      core.call("decodedNothing", low, high, error);
    core.changed();
  });
  module = await create({
    locateFile : () => files.viewerWasm,
               // The C++ code calls these (client/web/web_decoder.cpp, web_fetcher.cpp, static_page.cpp).
               decode,
    fetchRange : (...args) => core.fetchRange(...args),
    cancelRange : (job) => core.cancelRange(job),
                readParameters(text) {
                  const found = parametersOf(text);
                  if (found) core.withNumbers(found.numbers, (at) => core.call("takeParameters", at, found.tree));
                },
  });

  /// Copies bytes to an address. The caller makes the room first: memory may grow then, which replaces HEAPU8.
  function fill(at, bytes) { module.HEAPU8.set(bytes, at); }

  const {call, text, rows} = callsOf(module);

  const core = {
    call,
    text,
    rows,
    fill,
    /// Calls `use` with the address of these numbers as doubles.
    withNumbers(numbers, use) {
      const at = module._malloc(8 * numbers.length);
      fill(at, new Uint8Array(Float64Array.from(numbers).buffer));
      const result = use(at);
      module._free(at);
      return result;
    },
    /// A published scene replaces these two.
    fetchRange: () => {},
    cancelRange: () => {},
    figures: () => ({
      ...Object.fromEntries(rows("figures").map(([name, value]) => [name, Number(value)])),
      wasmBytes: module.HEAPU8.length
    }),
    /// The page sets this; it is called when data arrived that may change the picture.
    changed: () => {},
    connected: () => call("connected"),
    disconnected: (reason) => call("disconnected", reason),
    refused: () => call("refused") !== 0,
    methodInstead: () => text("methodInstead"),
    receive(bytes) {
      fill(call("messageBuffer", bytes.length), bytes);
      return text("receiveMessage");
    },
    next() {
      const size = call("nextToSend");
      if (size === 0) return null;
      const at = call("messageToSend");
      return module.HEAPU8.slice(at, at + size);
    },
  };
  return core;
}
