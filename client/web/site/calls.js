// Calls a WebAssembly module's exported functions: strings are passed as UTF-8, and rows of text are taken apart
// (client/web/text_rows.h).

const utf8 = new TextEncoder();

/// Takes rows of tab-separated fields apart.
function rowsOf(text) { return text === "" ? [] : text.slice(0, -1).split("\n").map((row) => row.split("\t")); }

/// Returns {call(name, ...args), text(name, ...args), rows(name, ...args)} of a module.
export function callsOf(module) {
  function call(name, ...args) {
    const held = [];
    const plain = args.map((arg) => {
      if (typeof arg !== "string") return arg;
      const bytes = utf8.encode(arg);
      const at = module._malloc(bytes.length + 1);
      module.HEAPU8.set(bytes, at);
      module.HEAPU8[at + bytes.length] = 0;
      held.push(at);
      return at;
    });
    const result = module["_" + name](...plain);
    for (const at of held) module._free(at);
    return result;
  }
  const text = (name, ...args) => module.UTF8ToString(call(name, ...args));
  return {call, text, rows: (name, ...args) => rowsOf(text(name, ...args))};
}
