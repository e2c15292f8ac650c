// Tests the page's image decoder: frames in WebP with alpha, as `lumigrid serve` sends them.
import assert from "node:assert/strict";
import {readdirSync} from "node:fs";
import {after, before, test} from "node:test";

import {cleanUp, launch, open, sampleScene, serve, site} from "./lib.mjs";

const kSide = 32;
let page;

const builtFile = (pattern) => `/${readdirSync(site).find((name) => pattern.test(name))}`;

before(async () => {
  const server = await serve(sampleScene(), {args: ["--no-frames"]});
  page = await open(await launch(), server.url);
  await page.evaluate(([script, wasm]) => {
    const worker = new Worker(script, {type: "module"});
    let job = 0;
    window.decodeValue = (bytes) => new Promise((done) => {
      worker.onmessage = ({data}) => done({error: data.error, rgba: data.image && [...data.image.rgba]});
      worker.postMessage({job: job++, wasm: new URL(wasm, document.baseURI).href, bytes});
    });
    window.crc32c = (bytes) => {
      let crc = ~0;
      for (const byte of bytes) {
        crc ^= byte;
        for (let bit = 0; bit < 8; ++bit) crc = (crc >>> 1) ^ (crc & 1 ? 0x82F63B78 : 0);
      }
      return ~crc >>> 0;
    };
    // A face's value: magic, version, kind, 0, checksum, two lengths, picture, mask (docs/formats/repository.md).
    window.valueOf = (picture, mask) => {
      const head = [0x46, 1, 1, 0];
      const lengths = new Uint8Array(new Uint32Array([picture.length, mask.length]).buffer);
      const body = [...lengths, ...picture, ...mask];
      const sum = new Uint8Array(new Uint32Array([window.crc32c([...head, ...body])]).buffer);
      return new Uint8Array([...head, ...sum, ...body]);
    };
    // The left part is covered, four columns are half so, and the rest is not.
    window.webpOf = async (side, covered) => {
      const canvas = new OffscreenCanvas(side, side);
      const context = canvas.getContext("2d");
      context.fillStyle = "rgb(230 120 60)";
      context.fillRect(0, 0, covered, side);
      context.fillStyle = "rgb(230 120 60 / 50%)";
      context.fillRect(covered, 0, 4, side);
      const blob = await canvas.convertToBlob({type: "image/webp", quality: 0.95});
      return new Uint8Array(await blob.arrayBuffer());
    };
  }, [builtFile(/^decode-\w+\.js$/), builtFile(/^decode-\w+\.wasm$/)]);
});
after(cleanUp);

const decodeWebp = (covered, mask = []) => page.evaluate(
    async ([side, covered, mask]) => window.decodeValue(window.valueOf(await window.webpOf(side, covered), mask)),
    [kSide, covered, mask]);

function expectPixel(image, x, alpha) {
  const pixel = image.rgba.slice(4 * (5 * kSide + x), 4 * (5 * kSide + x) + 4);
  [230, 120, 60, alpha].forEach((value, i) => assert.ok(Math.abs(pixel[i] - value) < 16, `at ${x}: ${pixel}`));
}

test("WebP keeps its alpha, and its colours go on where there is no coverage", async () => {
  const image = await decodeWebp(16);
  assert.equal(image.error, undefined);
  expectPixel(image, 4, 255);
  expectPixel(image, 18, 128);
  expectPixel(image, 21, 0);
  expectPixel(image, 31, 0);
});

test("the picture before does not shine through", async () => {
  await decodeWebp(28);
  expectPixel(await decodeWebp(8), 20, 0);
});

test("broken pictures end in one line", async () => {
  assert.match((await decodeWebp(16, [1, 2, 3])).error, /^WebP: a mask comes with it/);
  const broken = await page.evaluate(
      () => window.decodeValue(window.valueOf([...new TextEncoder().encode("RIFF\x04\0\0\0WEBP")], [])));
  assert.ok(broken.error && !broken.error.includes("\n"), broken.error);
});
