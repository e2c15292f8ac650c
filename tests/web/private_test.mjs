// Tests private scenes over TLS, and that pages of other hosts read nothing that they shall not.
import assert from "node:assert/strict";
import {execFileSync} from "node:child_process";
import {mkdirSync, writeFileSync} from "node:fs";
import {basename, join} from "node:path";
import {after, before, test} from "node:test";

import {cleanUp, folder, launch, nginx, open, run, sampleScene, serve, settled, until} from "./lib.mjs";

const kToken = "token-of-the-only-scene";
let scene, server, local, browser, elsewhere;

before(async () => {
  scene = sampleScene({triangles: 20000});
  const file = (name) => join(folder, name);
  writeFileSync(file("link.key"), `${"k".repeat(32)}\n`, {mode: 0o600});
  writeFileSync(
      file("tokens.json"), JSON.stringify([{token: kToken, scenes: [basename(scene)]}]), {mode: 0o600});
  execFileSync(
      "openssl",
      [
        "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "30", "-subj",
        "/CN=test", "-addext", "subjectAltName=IP:127.0.0.1", "-keyout", file("key.pem"), "-out", file("cert.pem")
      ],
      {stdio: "ignore"});
  server = await serve(scene, {
    args: [
      "--certificate", file("cert.pem"), "--key", file("key.pem"), "--tokens", file("tokens.json"), "--signing-key",
      file("link.key")
    ]
  });
  local = await serve(scene);
  mkdirSync(file("other"));
  writeFileSync(file("other/index.html"), "<!doctype html><title>other</title>");
  elsewhere = await nginx(file("other"));
  browser = await launch("mesa", ["--host-resolver-rules=MAP evil.example 127.0.0.1"]);
});
after(cleanUp);

const visit = (url) => open(browser, url, {ignoreHTTPSErrors: true});
const signed = (expires, url = server.url, name = basename(scene)) =>
    run("lumigrid", ["sign", "--key", join(folder, "link.key"), "--scene", name, "--expires", expires, url]).trim();

test("a token's link and a signed one show the scene, and leave the address", async () => {
  assert.match(server.url, /^https:/);
  for (const link of [`${server.url}?token=${kToken}&method=patches`, signed("1h", `${server.url}?method=patches`)]) {
    const page = await visit(link);
    await settled(page);
    assert.equal(page.url().split("#")[0], `${server.url}?method=patches`);
    assert.equal(await page.evaluate(() => document.cookie), "", "a script could read the cookie");
    const [cookie] = await page.context().cookies();
    assert.ok(cookie.httpOnly && cookie.secure && cookie.sameSite === "Lax", JSON.stringify(cookie));
    await page.reload();
    await settled(page);
    assert.deepEqual(page.faults, []);
    await page.context().close();
  }
});

test("no, wrong, expired and replayed credentials are told as such", async () => {
  const later = signed("1s");
  await new Promise((done) => setTimeout(done, 1500));
  for (const [url, words] of [
           [server.url, /private/],
           [`${server.url}?token=token-of-nobody-at-all`, /not valid here/],
           [later, /expired/],
           [signed("1h", server.url, "another"), /not valid here/],
  ]) {
    const page = await visit(url);
    assert.match(await page.locator("body").innerText(), words, url);
    await page.context().close();
  }
});

/// Returns whether the page of another host gets at `url`, for each way that it has.
const reach = (page, url) => page.evaluate(async (url) => {
  const answered = (promise) => promise.then(() => true, () => false);
  const event = (target, good, bad) => new Promise((done) => {
    target[good] = () => done(true);
    target[bad] = () => done(false);
  });
  const image = new Image();
  const drawn = event(image, "onload", "onerror");  // before it can happen
  image.src = `${url}render?position=0,0,99&direction=0,0,-1&width=8&height=8`;
  return {
    fetch: await answered(fetch(`${url}scene.json`)),
    cookies: await answered(fetch(`${url}scene.json`, {credentials: "include"})),
    socket: await event(new WebSocket(url.replace(/^http/, "ws")), "onopen", "onerror"),
    image: await drawn,
  };
}, url);

test("a page of another host reads neither a private server nor a local one", async () => {
  const page = await visit(`${server.url}?token=${kToken}&method=patches`);
  await settled(page);
  await page.goto(elsewhere.url);  // with the cookie of a visitor who is in
  for (const url of [server.url, local.url])
    assert.deepEqual(await reach(page, url), {fetch: false, cookies: false, socket: false, image: false}, url);
  await page.context().close();
});

test("a name of another host that leads here is refused", async () => {
  const page = await visit(`http://evil.example:${local.port}/`);
  assert.match(await page.locator("body").innerText(), /--host/);
  await page.context().close();
  const good = await visit(local.url);
  await settled(good);
  await good.context().close();
});

test("a viewer is let go when its link ends", async () => {
  const page = await visit(signed("4s", `${server.url}?method=patches`));
  await settled(page);
  await until(async () => /expired/.test(server.log()), "the log to tell");
  await until(async () => /expired/.test(await page.locator("body").innerText()), "the page to tell");
  await page.context().close();
});

test("the log holds no credential", () => {
  for (const secret of [kToken, "token-of-nobody", "k".repeat(32), "signature=", "token="])
    assert.ok(!server.log().includes(secret), secret);
});
