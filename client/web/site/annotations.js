// Notes of the scene (docs/formats/annotations.md): read as JSON here, checked by the C++ client.

const kMostBytes = 16_000_000;

const triple = (value) => Array.isArray(value) && value.length === 3 && value.every((x) => typeof x === "number");

/// Adds one to the client; the empty text, or what is wrong with it.
function add(core, one) {
  if (typeof one !== "object" || one === null || typeof one.title !== "string" || !triple(one.position)) return "needs a title and a position of three numbers";
  const normal = one.normal ?? [0, 0, 0];
  const text = one.text ?? "";
  if (!triple(normal) || typeof text !== "string") return "has a normal that is not three numbers, or a text that is none";
  const error = core.text("addAnnotation", one.title, text, ...one.position, ...normal);
  if (error || one.camera === undefined) return error;
  const { position, direction, up = [0, 0, 1], fov_y: fov = Math.PI / 4 } = one.camera ?? {};
  if (!triple(position) || !triple(direction) || !triple(up) || typeof fov !== "number") return "has a camera without position and direction";
  return core.text("addAnnotationCamera", ...position, ...direction, ...up, fov);
}

/// Loads them into the client and into `shown`; says what could not be used.
export async function loadAnnotations(url, core, shown, say) {
  let document;
  try {
    const answer = await fetch(url);
    if (answer.status === 404) return;
    if (!answer.ok) return say(`no notes: the server answered ${answer.status} for annotations.json`);
    if (Number(answer.headers.get("Content-Length") ?? 0) > kMostBytes) return say("no notes: annotations.json is too large");
    document = await answer.json();
  } catch (error) {
    return say(`no notes: annotations.json cannot be read (${error.message})`);
  }
  const list = document?.annotations;
  if (document?.version !== 1 || !Array.isArray(list)) return say("no notes: annotations.json is not of version 1; see docs/formats/annotations.md");
  for (const [i, one] of list.entries()) {
    const error = add(core, one);
    if (error) say(`note ${i + 1} is left out: it ${error}`);
    else shown.push({ title: one.title, text: one.text ?? "" });
  }
  core.call("setAnnotations");
}
