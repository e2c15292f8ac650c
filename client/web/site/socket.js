// The WebSocket to a lumigrid server: bytes in, bytes out, and again after every loss.

const kFirstDelay = 250;
const kLongestDelay = 5000;

/// Where the page's own server takes viewers.
export function socketUrl(page) {
  const url = new URL("ws", page);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  url.search = "";
  url.hash = "";
  return url.href;
}

/// `core`: connected(), disconnected(reason), receive(bytes) -> error text, next() -> bytes or null, refused() ->
/// whether trying again is of no use, splatsOnly() -> whether that is since the scene has nothing else: then
/// `showSplats()`.
export function openLink(url, core, changed, showSplats) {
  let socket = null;
  let delay = kFirstDelay;
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
    timer = setTimeout(open, delay);
    delay = Math.min(2 * delay, kLongestDelay);
  }

  function open() {
    clearTimeout(timer);
    if (socket) return;
    const mine = (socket = new WebSocket(url));
    mine.binaryType = "arraybuffer";
    mine.onopen = () => {
      core.connected();
      flush();
    };
    mine.onmessage = ({data}) => {
      if (socket !== mine) return;
      delay = kFirstDelay;
      const error = typeof data === "string" ? "the server sent text; is it a lumigrid server?" :
                                               core.receive(new Uint8Array(data));
      if (error) {
        mine.onclose = null;
        mine.close();
        return lost(error);
      }
      if (core.splatsOnly()) return showSplats();
      flush();
      changed();
    };
    mine.onclose = ({reason}) => {
      if (socket === mine) lost(reason || "the connection to the server was lost");
    };
  }

  open();
  // Coming back to the network or to the page is a reason to try at once.
  const retry = () => {
    delay = kFirstDelay;
    if (!socket && !core.refused()) open();
  };
  addEventListener("online", retry);
  return {flush, retry};
}
