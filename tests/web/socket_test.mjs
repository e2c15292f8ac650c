// Tests how the page's link to a server is opened again after a loss, with a clock and sockets of the test's own.
import assert from "node:assert/strict";
import {test} from "node:test";

import {openLink} from "../../client/web/site/socket.js";

let timers, sockets;

class FakeSocket {
  static OPEN = 1;
  constructor() { sockets.push(this); }
  close() {}
}

/// Opens a link, each of whose sockets is lost at once, and returns the first `count` delays.
function delays(count, random) {
  timers = [];
  sockets = [];
  Object.assign(globalThis, {
    WebSocket: FakeSocket,
    addEventListener() {},
    setTimeout: (call, delay) => timers.push({call, delay}),
    clearTimeout() {},
  });
  const draw = Math.random;
  Math.random = random;
  const core = {connected() {}, disconnected() {}, refused: () => false};
  openLink("ws://host/ws", core, () => {}, () => {});
  for (let i = 0; i < count; ++i) {
    sockets.at(-1).onclose({reason: "the server stops"});  // a reason, or it asks for one
    timers.at(-1).call();
  }
  Math.random = draw;
  return timers.map(({delay}) => delay);
}

test("pauses double up to a largest one", () => {
  assert.deepEqual(delays(7, () => 0.5), [250, 500, 1000, 2000, 4000, 5000, 5000]);
});

test("each is drawn from half to one and a half times that", () => {
  assert.deepEqual(delays(2, () => 0), [125, 250]);
  assert.deepEqual(delays(2, () => 1), [375, 750]);
  assert.equal(new Set(delays(100, Math.random).slice(10)).size, 90);
});
