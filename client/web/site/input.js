// Translates the page's events for the C++ client: device pixels from the canvas' upper left corner, seconds.

const kKinds = ["mouse", "touch", "pen"];  // as PointerKind in client/app/input.h
/// Browsers report this for one notch of a common mouse wheel.
const kPixelsPerStep = 100;
const kLinesPerStep = 3;

const modifiersOf = (event) =>
    (event.shiftKey ? 1 : 0) | (event.ctrlKey || event.metaKey ? 2 : 0) | (event.altKey ? 4 : 0);

function stepsOf(event) {
  const perStep = [kPixelsPerStep, kLinesPerStep, 1][event.deltaMode] ?? kPixelsPerStep;
  // Browsers report a pinch on a touchpad as a wheel with ctrl, in small steps.
  const pinch = event.ctrlKey && event.deltaMode === 0 && Math.abs(event.deltaY) < 40;
  return -event.deltaY / (pinch ? kPixelsPerStep / 8 : perStep);
}

/// Listens to the canvas. `now()` returns seconds. `acted()` is called after each event that was passed on.
export function listen(canvas, core, now, acted) {
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [
      ((event.clientX - box.left) * canvas.width) / Math.max(box.width, 1),
      ((event.clientY - box.top) * canvas.height) / Math.max(box.height, 1)
    ];
  };
  const button = (event) => (event.button === 1 ? 1 : event.button === 2 ? 2 : 0);
  const pointer = (what) => (event) => {
    const [x, y] = place(event);
    core.call(
        "pointer", what, event.pointerId, Math.max(0, kKinds.indexOf(event.pointerType)), button(event),
        modifiersOf(event), x, y, now());
    acted();
  };
  const down = pointer(0);
  canvas.addEventListener("pointerdown", (event) => {
    canvas.focus({preventScroll: true});
    try {
      canvas.setPointerCapture(event.pointerId);
    } catch {
      // The pointer may be gone already; its end is then reported as usual.
    }
    down(event);
  });
  canvas.addEventListener("pointermove", pointer(1));
  canvas.addEventListener("pointerup", pointer(2));
  canvas.addEventListener("pointercancel", pointer(3));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        core.call("wheel", stepsOf(event), ...place(event), now());
        acted();
      },
      {passive: false},
  );
  // Safari's own pinch gesture would zoom the page.
  for (const name of ["gesturestart", "gesturechange"])
    canvas.addEventListener(name, (event) => event.preventDefault());

  const key = (isDown) => (event) => {
    // Keys typed into a dialog or field are not ours; but a key released there may have been pressed here.
    const busy = event.target instanceof Element && event.target.closest("input, select, textarea, dialog");
    if (isDown && (busy || event.altKey || event.isComposing)) return;
    // Leave the browser its own keys for copying, finding, reloading, except a bookmark's digit.
    if (isDown && (event.ctrlKey || event.metaKey) && !/^(Digit|Numpad)\d$/.test(event.code)) return;
    // A focused button takes the keys that press it.
    if (isDown && event.target instanceof HTMLButtonElement && ["Enter", " "].includes(event.key)) return;
    if (core.call("key", event.code, event.key, isDown ? 1 : 0, modifiersOf(event), now()) && !busy)
      event.preventDefault();
    acted();
  };
  addEventListener("keydown", key(true));
  addEventListener("keyup", key(false));
  addEventListener("blur", () => {
    core.call("blur");
    acted();
  });
}
