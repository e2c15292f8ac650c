// One of the page's decoders: the browser decodes the JPEG or WebP, WebAssembly the coverage mask.
import createDecoder from "client_web_decode.js";

let ready;
let canvas, context;

function decoder(wasm) {
  ready ??= createDecoder({locateFile: () => wasm});
  return ready;
}

async function pixelsOf(picture, type) {
  const bitmap = await createImageBitmap(
      new Blob([picture], {type}), {premultiplyAlpha: "none", colorSpaceConversion: "none"});
  const {width, height} = bitmap;
  if (!canvas || canvas.width !== width || canvas.height !== height) {
    canvas = new OffscreenCanvas(width, height);
    context = canvas.getContext("2d", {willReadFrequently: true});
    context.globalCompositeOperation = "copy";  // else the last picture would shine through where this has alpha
  }
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  return context.getImageData(0, 0, width, height);
}

async function decode(wasm, bytes) {
  const module = await decoder(wasm);
  const value = module._valueBuffer(bytes.length);  // this comes first: memory may grow, which replaces HEAPU8
  module.HEAPU8.set(bytes, value);
  const kind = module._parseValue();
  if (kind < 0) throw new Error(module.UTF8ToString(module._errorText()));
  if (kind === 0) return null;
  const data = module._pictureData();
  const type = module._pictureIsWebp() ? "image/webp" : "image/jpeg";
  const image = await pixelsOf(module.HEAPU8.slice(data, data + module._pictureSize()), type);
  const pixels = module._pixelBuffer(image.width, image.height);
  if (!pixels) throw new Error(`an image of ${image.width} x ${image.height} pixels is no face`);
  module.HEAPU8.set(image.data, pixels);
  if (!module._applyCoverage()) throw new Error(module.UTF8ToString(module._errorText()));
  return {width: image.width, height: image.height, rgba: module.HEAPU8.slice(pixels, pixels + image.data.length)};
}

// Images are decoded one at a time, since the module holds one.
let last = Promise.resolve();
self.onmessage = ({data}) => {
  last = last.then(async () => {
    try {
      const image = await decode(data.wasm, data.bytes);
      self.postMessage({job: data.job, image}, image ? [image.rgba.buffer] : []);
    } catch (error) {
      self.postMessage({job: data.job, error: String(error?.message ?? error)});
    }
  });
};
