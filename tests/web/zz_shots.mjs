import { launch, open, figures, cleanUp, until, waitFor } from "./lib.mjs";
const out = "/tmp/serve-work/";
const url = process.argv[2];
const browser = await launch();
for (const [name, options] of [["desk", { viewport: { width: 1440, height: 900 } }], ["phone", { viewport: { width: 390, height: 844 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true }]]) {
  const page = await open(browser, url, options);
  await waitFor(page, (n) => n.splats > 0, "splats", 60000);
  await page.screenshot({ path: `${out}${name}-first.png` });
  await page.keyboard.press("i");
  const [w, h] = [options.viewport.width / 2, options.viewport.height / 2];
  if (!options.hasTouch) {
    await page.mouse.move(w, h); await page.mouse.down();
    for (let i = 0; i < 12; ++i) { await page.mouse.move(w + 12 * i, h + 3 * i); await page.waitForTimeout(80); }
    await page.screenshot({ path: `${out}${name}-moving.png` });
    await page.mouse.up();
  } else {
    const session = await page.context().newCDPSession(page);
    const touch = (type, x, y) => session.send("Input.dispatchTouchEvent", { type, touchPoints: type === "touchEnd" ? [] : [{ x, y }] });
    await touch("touchStart", w, h);
    for (let i = 1; i < 12; ++i) { await touch("touchMove", w + 8 * i, h + 2 * i); await page.waitForTimeout(80); }
    await page.screenshot({ path: `${out}${name}-moving.png` });
    await touch("touchEnd");
  }
  await waitFor(page, (n) => n.complete === 1, "rest", 90000).catch((e) => console.log(e.message));
  await page.waitForTimeout(1500);
  await page.screenshot({ path: `${out}${name}-rest.png` });
  await page.keyboard.press("l");
  await page.waitForTimeout(3000);
  await page.screenshot({ path: `${out}${name}-lens.png` });
  await page.keyboard.press("c");
  await page.waitForTimeout(2500);
  await page.screenshot({ path: `${out}${name}-tint.png` });
  await page.keyboard.press("c");
  await page.keyboard.press("h");
  await page.waitForTimeout(500);
  await page.screenshot({ path: `${out}${name}-help.png` });
  await page.keyboard.press("Escape");
  await page.waitForTimeout(300);
  await page.keyboard.press("g");
  await page.waitForTimeout(500);
  await page.screenshot({ path: `${out}${name}-settings.png` });
  console.log(name, JSON.stringify(await figures(page)), page.faults);
  await page.close();
}
await cleanUp();
