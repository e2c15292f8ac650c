// Saves pictures: of any size from the server, or the screen's; and other files.
import {element} from "./dom.js";

export function saveBlob(blob, name) {
  const link = element("a", {href: URL.createObjectURL(blob), download: name});
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

/// Returns the canvas as PNG on the page's background. It is drawn again first, since a frame is gone once it was
/// shown.
function screenPicture(canvas, draw) {
  draw();
  const {width, height} = canvas;
  const copy = element("canvas", {width, height});
  const context = copy.getContext("2d");
  const style = getComputedStyle(document.documentElement);
  const shade = context.createRadialGradient(
      0.5 * width, 0.42 * height, 0, 0.5 * width, 0.42 * height, 0.75 * Math.max(width, height));
  shade.addColorStop(0, style.getPropertyValue("--near"));
  shade.addColorStop(1, style.getPropertyValue("--far"));
  context.fillStyle = shade;
  context.fillRect(0, 0, width, height);
  context.drawImage(canvas, 0, 0);
  return new Promise(
      (done, fail) =>
          copy.toBlob((blob) => (blob ? done(blob) : fail(new Error("the browser made no picture"))), "image/png"));
}

async function serverPicture(base, query, width, height) {
  const answer = await fetch(new URL(`render?${query}&width=${width}&height=${height}`, base));
  if (!answer.ok) throw new Error((await answer.text()).trim() || `the server answered ${answer.status}`);
  return answer.blob();
}

/// Asks for the size, then saves. `server`: the URL beside which /render is, or null without a server. `query`: the
/// client's query for /render.
export function openPicture({dialog, canvas, query, server, draw, name, say}) {
  const form = dialog.querySelector("#picture-form");
  const {width, height, source} = form.elements;
  width.value = canvas.width;
  height.value = canvas.height;
  source.options[0].disabled = server === null;
  source.value = server === null ? "screen" : "server";
  source.onchange = () => (width.disabled = height.disabled = source.value === "screen");
  source.onchange();
  form.onsubmit = async (event) => {
    event.preventDefault();
    dialog.close();
    const fromServer = source.value === "server";
    if (fromServer) say("the server renders the picture …", false);
    try {
      const blob = fromServer ? await serverPicture(server, query, Number(width.value), Number(height.value)) :
                                await screenPicture(canvas, draw);
      saveBlob(blob, `${name || "lumigrid"}.png`);
      say(`picture saved as ${name || "lumigrid"}.png`, false);
    } catch (error) {
      say(`no picture: ${error.message}`, true);
    }
  };
  dialog.showModal();
}
