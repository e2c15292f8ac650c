// Which of the page's two programs is wanted: by the scene that lies beside the page, a link, the address or the
// settings, in this order. Runs in index.html before all else, where it has the right WebAssembly fetched, and again as
// a part of main.js, for hosts whose policy forbids the first.
window.lumigridMethod = () => {
  const only = document.querySelector('meta[name="lumigrid-method"]')?.content;
  const query = new URLSearchParams(location.search);
  if (only && !query.has("scene")) return {name: only, said: true};
  const link = new URLSearchParams(location.hash.slice(1));
  const said = link.get("m") ?? (link.has("v") ? "lumigraph" : query.get("method"));
  if (said) return {name: said, said: true};
  let kept;
  try {
    kept = JSON.parse(localStorage.getItem("lumigrid.settings"))?.method;
  } catch {
    // None, or none of ours.
  }
  return {name: kept ?? "lumigraph", said: false};
};
if (document.currentScript) {
  const files = document.currentScript.dataset;
  const splats = window.lumigridMethod().name === "qsplat";
  const fetchEarly = (properties) => document.head.append(Object.assign(document.createElement("link"), properties));
  fetchEarly({ rel: "preload", as: "fetch", type: "application/wasm", crossOrigin: "anonymous", href: splats ? files.splats : files.viewer });
  if (splats) fetchEarly({rel: "modulepreload", href: files.script});
}
