// Tests of page, stream and tracker over https and wss, with the certificate that deploy/certificate makes.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import http from "node:http";
import { networkInterfaces, tmpdir } from "node:os";
import { after, before, test } from "node:test";
import { Client, Process, WebSocket, browser, build, gateway, publisher, show, source, until } from "./harness.mjs";

const folder = mkdtempSync(`${tmpdir()}/softhand_certificate_`);
const NAME = "softhand.test";
const trusted = { rejectUnauthorized: false };
// An address other than localhost, because localhost is always a secure context.
const lan = Object.values(networkInterfaces())
  .flat()
  .find(({ family, internal }) => family === "IPv4" && !internal)?.address;
const tls = (part) =>
  [
    "address=0.0.0.0",
    `hosts=${NAME} ${lan ?? ""}`,
    `certificate=${folder}/certificate.pem`,
    `key=${folder}/key.pem`,
  ].map((setting) => `${part}.${setting}`);
let chromium, viewer;

before(async () => {
  execFileSync(`${source}/deploy/certificate`, [folder, NAME]);
  publisher();
  viewer = await gateway(0, ...tls("viewer"));
  chromium = await browser();
});
after(async () => {
  await chromium?.close();
  await Promise.all([...Process.all].map((process) => process.end("SIGKILL")));
  rmSync(folder, { recursive: true });
});

/** Status and `location` header of a request over plain HTTP to one of this machine's addresses. */
const get = (host, headers = {}, address = "127.0.0.1") =>
  new Promise((done, failed) =>
    http
      .get(
        {
          host: address,
          port: viewer.port,
          path: "/?plain",
          headers: { host: `${host}:${viewer.port}`, ...headers },
        },
        (response) => {
          response.resume();
          done({ status: response.statusCode, location: response.headers.location });
        },
      )
      .on("error", failed),
  );

test("the certificate contains the requested names and is reused while it is valid", () => {
  const text = execFileSync("openssl", ["x509", "-noout", "-text", "-in", `${folder}/certificate.pem`], {
    encoding: "utf8",
  });
  for (const name of ["DNS:localhost", "IP Address:127.0.0.1", `DNS:${NAME}`]) assert.ok(text.includes(name), name);
  const serial = () =>
    execFileSync("openssl", ["x509", "-noout", "-serial", "-in", `${folder}/certificate.pem`], { encoding: "utf8" });
  const first = serial();
  execFileSync(`${source}/deploy/certificate`, [folder, NAME]);
  assert.equal(serial(), first);
});

test("the page over https is a secure context and draws the hand", async () => {
  assert.match(viewer.url, /^https:/);
  const context = await chromium.newContext({ ignoreHTTPSErrors: true });
  const page = await context.newPage();
  await page.goto(`https://${lan ?? "localhost"}:${viewer.port}/?quality=low`);
  assert.equal(await page.evaluate(() => isSecureContext), true);
  await until("nodes", () => page.evaluate(() => window.softhand?.counts.nodes > 10), 60);
  assert.equal(await page.evaluate(() => window.softhand.counts.bad), 0);
  await context.close();
});

test("localhost gets http on the same port, other hosts are redirected to https", async () => {
  assert.equal((await get("localhost")).status, 200);
  assert.deepEqual(await get(NAME), { status: 301, location: `https://${NAME}:${viewer.port}/?plain` });
  assert.equal((await get("elsewhere.test")).status, 403);
  // Another machine may write any name.
  if (lan) assert.equal((await get("localhost", {}, lan)).status, 301);
});

test("the printed addresses have the port that the gateway got", async () => {
  const other = await gateway(viewer.port, ...tls("viewer"));
  assert.notEqual(other.port, viewer.port);
  const name = NAME.replace(".", "\\.");
  await other.process.line(new RegExp(`elsewhere at https://${name}:${other.port}/\\?token=\\w+\n`));
  await other.process.end();
});

test("the stream checks the origin over wss", async () => {
  const url = `https://127.0.0.1:${viewer.port}`;
  const own = new Client(url, { ...trusted, origin: url });
  await own.opened;
  own.socket.send(show(1 << 2));
  await until("nodes", () => (own.count.get(2) ?? 0) > 3);
  own.socket.terminate();
  const foreign = new Client(url, { ...trusted, origin: "https://elsewhere.test" });
  await assert.rejects(foreign.opened);
});

test("the webxr tracker accepts wss from the page over https", async () => {
  const settings = ["tracker_webxr.port=0", ...tls("tracker_webxr")].flatMap((setting) => ["--set", setting]);
  const tracker = new Process(
    `${build}/bin/softhand-tracker-webxr`,
    "--config",
    `${source}/config/scenes/pinch.toml`,
    ...settings,
  );
  const [, port] = await tracker.line(/listening at wss:\S+:(\d+)/);
  const opened = (url, options) =>
    new Promise((done) => {
      const socket = new WebSocket(url, options);
      socket.on("open", () => done(true) ?? socket.terminate());
      socket.on("error", () => done(false));
    });
  assert.ok(await opened(`wss://127.0.0.1:${port}`, { ...trusted, origin: `https://127.0.0.1:${viewer.port}` }));
  assert.ok(!(await opened(`wss://127.0.0.1:${port}`, { ...trusted, origin: "https://elsewhere.test" })));
  assert.ok(await opened(`ws://127.0.0.1:${port}`, { origin: `http://127.0.0.1:${viewer.port}` }));
});

test("a missing certificate is refused with its path", async () => {
  const settings = ["viewer.port=0", "viewer.certificate=/nowhere.pem"].flatMap((setting) => ["--set", setting]);
  const wrong = new Process(
    `${build}/bin/softhand-viewer`,
    "--config",
    `${source}/config/scenes/pinch.toml`,
    ...settings,
  );
  await wrong.line(/certificate \/nowhere\.pem: /);
});
