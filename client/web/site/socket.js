// Connects the client to a lumigrid server by a WebSocket, again after every loss.

// Milliseconds between tries, and their spread, as the other viewer has them (client/source/backoff.h): when a server
// starts anew, its viewers come back spread over time.
const kMinDelay = 250;
const kMaxDelay = 5000;
const spread = (delay) => delay * (0.5 + Math.random());

/// Returns the address at which the page's own server accepts viewers, without the page's query and hash.
export function socketUrl(page) {
  const url = new URL("ws", page);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  return url.href;
}

/// Returns the server's own words where it lets nobody in (docs/private-scenes.md), else "". A WebSocket tells none.
async function refusalAt(url) {
  try {
    const answer = await fetch(new URL("scene.json", url.replace(/^ws/, "http")), {cache: "no-store"});
    return [401, 403].includes(answer.status) ? (await answer.text()).trim() : "";
  } catch {
    return "";
  }
}

/// Opens the link. `core` has connected(), disconnected(reason), receive(bytes) -> error text, next() -> bytes or null,
/// refused() -> whether another try is of no use, and methodInstead() -> the method that shows the scene, or nothing:
/// `showOther(method)` is called then.
export function openLink(url, core, changed, showOther) {
  let socket = null;
  let delay = kMinDelay;
  let timer = 0;

  function flush() {
    if (socket?.readyState !== WebSocket.OPEN) return;
    for (let bytes = core.next(); bytes; bytes = core.next()) socket.send(bytes);
  }

  function lost(reason) {
    socket = null;
    core.disconnected(reason);
    changed();
    if (core.refused()) return;
    timer = setTimeout(open, spread(delay));
    delay = Math.min(2 * delay, kMaxDelay);
  }

  function open() {
    clearTimeout(timer);
    if (socket) return;
    const mine = (socket = new WebSocket(url));
    let opened = false;
    mine.binaryType = "arraybuffer";
    mine.onopen = () => {
      opened = true;
      core.connected();
      flush();
    };
    mine.onmessage = ({data}) => {
      if (socket !== mine) return;
      delay = kMinDelay;
      const error = typeof data === "string" ? "the server sent text; is it a lumigrid server?" :
                                               core.receive(new Uint8Array(data));
      if (error) {
        mine.onclose = null;
        mine.close();
        return lost(error);
      }
      const other = core.methodInstead();
      if (other) return showOther(other);
      flush();
      changed();
    };
    mine.onclose = async ({reason}) => {
      const why = reason || (!opened && await refusalAt(url)) || "the connection to the server was lost";
      if (socket === mine) lost(why);
    };
  }

  open();
  // Try at once when the browser is back on the network.
  const retry = () => {
    delay = kMinDelay;
    if (!socket && !core.refused()) open();
  };
  addEventListener("online", retry);
  return {flush, retry};
}
