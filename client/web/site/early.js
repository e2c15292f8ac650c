// Decides which of the page's programs is needed: by a link, the address, the scene that lies beside the page or the
// settings, in this order. It runs in index.html before everything else, to fetch the right WebAssembly early, and
// again as a part of main.js, for hosts whose policy forbids inline scripts.
const isStreamed = (name) => ["qsplat", "pmr", "hlod"].includes(name);
window.lumigridMethod = () => {
  const only = document.querySelector('meta[name="lumigrid-method"]')?.content;
  const query = new URLSearchParams(location.search);
  const link = new URLSearchParams(location.hash.slice(1));
  const said = link.get("m") ?? (link.has("v") ? "lumigraph" : query.get("method"));
  // The scene beside the page has no patches. Where it lacks what is said, too, the page changes over to what it has.
  if (only && !query.has("scene")) return {name: isStreamed(said) ? said : only, said: false};
  if (said) return {name: said, said: true};
  let kept;
  try {
    kept = JSON.parse(localStorage.getItem("lumigrid.settings"))?.method;
  } catch {
    // There are no settings, or none of ours.
  }
  return {name: kept ?? "lumigraph", said: false};
};
if (document.currentScript) {
  const files = document.currentScript.dataset;
  const {name} = window.lumigridMethod();
  const streamed = isStreamed(name);
  const fetchEarly = (properties) => document.head.append(Object.assign(document.createElement("link"), properties));
  const wasm = files[streamed ? name : "viewer"];
  fetchEarly({rel: "preload", as: "fetch", type: "application/wasm", crossOrigin: "anonymous", href: wasm});
  if (streamed) fetchEarly({rel: "modulepreload", href: files[`${name}Script`]});
}
