// Tests of the gateway with plain WebSocket clients.
import assert from "node:assert/strict";
import { copyFileSync, mkdtempSync, rmSync } from "node:fs";
import { connect } from "node:net";
import { networkInterfaces, tmpdir } from "node:os";
import { after, before, test } from "node:test";
import {
  Client,
  MESSAGE,
  Process,
  SHOW,
  build,
  frame,
  gateway,
  message,
  pause,
  publisher,
  show,
  source as tree,
  until,
} from "./harness.mjs";

const NODES = 1 << 2;
const DESCRIPTION = 1 << 1;
const CONTACTS = 1 << 6;
const STATUS = 1 << 10;
const CHOICES = 1 << 13;
const RATE = 59; // Hz, of the publisher; in one second it takes every phase relative to the gateway's 60 Hz
const TYPE_OF_NODES = 2;
const SEQUENCE_AT = 16; // in a stamp

let source, viewer, slowResponse;
before(async () => {
  source = publisher(RATE);
  viewer = await gateway();
  slowResponse = readSlowlyAfterIdling();
  slowResponse.catch(() => {}); // the last test reports it
});
after(() => Promise.all([...Process.all].map((process) => process.end("SIGKILL"))));

/** Idles for 27 s and then takes 5 s to read a response. The other tests run meanwhile. */
async function readSlowlyAfterIdling() {
  const socket = connect(viewer.port, "127.0.0.1");
  const parts = [];
  socket.on("data", (part) => parts.push(part));
  const ask = (path) => socket.write(`GET ${path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n`);
  const answer = () => Buffer.concat(parts).toString("latin1");
  ask("/icon.svg");
  await until("the icon", () => answer().endsWith("</svg>\n"));
  await pause(27000); // of the 30 s that a request may take to come
  parts.length = 0;
  socket.pause(); // a slow network
  ask("/main.js");
  await pause(5000);
  socket.resume();
  const whole = () => {
    const [head] = answer().split("\r\n\r\n", 1);
    return answer().length === head.length + 4 + Number(/Content-Length: (\d+)/.exec(head)?.[1]);
  };
  await until("all of the page's code", whole, 5);
  socket.destroy();
}

/** The first line of the answer to a request for exactly this path. `fetch` would shorten "/..". */
async function statusLine(path) {
  const socket = connect(viewer.port, "127.0.0.1");
  socket.write(`GET ${path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n`);
  let answer = "";
  for await (const part of socket) answer += part.toString("latin1");
  return answer.split("\r\n", 1)[0];
}

async function client() {
  const one = new Client(viewer.url);
  await one.opened;
  return one;
}
async function leave(one) {
  one.socket.close();
  await one.closed;
}

test("each gateway has its own epoch", async () => {
  const other = await gateway();
  const epochs = [];
  for (const url of [viewer.url, other.url, viewer.url]) {
    const one = new Client(url);
    await one.opened;
    epochs.push((await one.state()).epoch);
    await leave(one);
  }
  assert.equal(epochs[0], epochs[2]);
  assert.notEqual(epochs[0], epochs[1]);
  await other.process.end();
});

test("serves the page and no other file", async () => {
  const index = await fetch(`${viewer.url}/`);
  assert.equal(index.status, 200);
  assert.match(await index.text(), /<title>softhand<\/title>/);
  assert.match((await fetch(`${viewer.url}/main.js`)).headers.get("content-type"), /javascript/);
  assert.match(await statusLine("/main.js"), /^HTTP\/1.1 200 /);
  for (const path of ["/../../../bin/softhand", "/%2e%2e/%2e%2e/%2e%2e/bin/softhand", "/../viewer/main.js", "/nothing"])
    assert.match(await statusLine(path), /^HTTP\/1.1 404 /, path);
});

test("reads and sends only what a page shows", async () => {
  const one = await client();
  await pause(500);
  assert.deepEqual(
    [...one.count.keys()].filter((type) => type !== 12),
    [],
  );
  assert.doesNotMatch(source.output, /surface read/);
  one.socket.send(show(DESCRIPTION | NODES));
  await until("nodes", () => one.count.get(2) > 30);
  await source.line(/surface read/);
  assert.equal(one.count.get(1), 1);
  assert.deepEqual(
    [...one.count.keys()].sort((a, b) => a - b),
    [1, 2, 12],
  );
  one.socket.send(show(CONTACTS));
  await source.line(/surface unread/);
  await until("contacts", () => one.count.get(6) > 10);
  const nodes = one.count.get(2);
  await pause(300);
  assert.equal(one.count.get(2), nodes);
  await leave(one);
});

test("a late page gets the description, and gets a slow rate if it asks for one", async () => {
  const [fast, slow] = [await client(), await client()];
  for (const [one, rate] of [
    [fast, 0],
    [slow, 10],
  ])
    one.socket.send(show(DESCRIPTION | NODES, rate));
  await until("both described", () => fast.count.get(1) === 1 && slow.count.get(1) === 1);
  const [fastBefore, slowBefore] = [fast.count.get(2) ?? 0, slow.count.get(2) ?? 0];
  await pause(2000);
  const [fastRate, slowRate] = [(fast.count.get(2) - fastBefore) / 2, (slow.count.get(2) - slowBefore) / 2];
  assert.ok(fastRate > 25, `${fastRate} Hz`);
  assert.ok(slowRate > 4 && slowRate < 12, `${slowRate} Hz`);
  // The node payload: three stamps, wrist, count, encoding, step, then int16 triples.
  const payload = fast.frames.get(2);
  assert.equal(payload.readUInt32LE(40), 1);
  assert.equal(Math.ceil((6 * payload.readUInt32LE(36)) / 4) * 4, payload.length - 48);
  assert.ok(Math.abs(payload.readFloatLE(28) - 0.06) < 1e-6);
  await Promise.all([leave(fast), leave(slow)]);
});

test("a late page gets the choices of the rig, which are written only once", async () => {
  const [early, late] = [await client(), await client()];
  early.socket.send(show(CHOICES));
  await until("choices", () => early.count.get(13) === 1);
  await pause(500);
  late.socket.send(show(CHOICES));
  await until("choices of a late page", () => late.count.get(13) === 1);
  const payload = late.frames.get(13);
  assert.equal(payload.toString("latin1", 0, 4), "rig\0");
  assert.equal(payload.readUInt32LE(64), 2);
  assert.equal(payload.toString("latin1", 72 + 136 + 64, 72 + 136 + 74), "pinch_lift");
  await Promise.all([leave(early), leave(late)]);
});

/** Share of the node samples published in the next `seconds` that arrived at each of `clients`. */
async function arriving(clients, seconds) {
  const now = () =>
    clients.map(({ count, frames }) => [
      count.get(TYPE_OF_NODES),
      frames.get(TYPE_OF_NODES).readDoubleLE(SEQUENCE_AT),
    ]);
  await until("nodes", () => clients.every(({ count }) => count.get(TYPE_OF_NODES) > 5));
  const before = now();
  await pause(1000 * seconds);
  return now().map(([count, sequence], i) => (count - before[i][0]) / (sequence - before[i][1]));
}

test("three pages get nearly every sample in any phase, and never more than the gateway's rate", async () => {
  const slow = await gateway(0, "viewer.rate_hz=20");
  const clients = [viewer, viewer, viewer, slow].map(({ url }) => new Client(url));
  await Promise.all(clients.map(({ opened }) => opened));
  for (const one of clients) one.socket.send(show(NODES));
  const parts = await arriving(clients, 6);
  await Promise.all(clients.map(leave));
  await slow.process.end();
  for (const part of parts.slice(0, 3)) assert.ok(part >= 57 / 60 && part <= 1.001, `${parts}`);
  assert.ok(Math.abs(parts[3] - 20 / RATE) < 0.03, `${parts}`);
});

test("a page that does not read loses frames, other pages do not", async () => {
  const [stuck, well] = [await client(), await client()];
  stuck.socket.send(show(DESCRIPTION | NODES));
  well.socket.send(show(NODES | STATUS));
  await until("both run", () => stuck.count.get(2) > 5 && well.count.get(2) > 5);
  stuck.socket.pause();
  const before = (await well.state()).passedOver;
  await until("frames for the stuck page are replaced", async () => (await well.state()).passedOver > before + 20, 60);
  const nodes = well.count.get(2);
  await pause(1000);
  assert.ok(well.count.get(2) > nodes + 20);
  stuck.socket.resume();
  await leave(stuck);
  await leave(well);
});

test("bad frames are refused and counted, and the connection goes on", async () => {
  const one = await client();
  one.socket.send(show(STATUS));
  const before = (await one.state()).refused;
  const text = (fields) =>
    Buffer.concat([
      Buffer.alloc(8),
      ...fields.map((field) => Buffer.concat([Buffer.from(field), Buffer.alloc(64)]).subarray(0, 64)),
    ]);
  const nan = Buffer.alloc(8);
  nan.writeFloatLE(NaN, 4);
  const bad = {
    size: [
      Buffer.alloc(3),
      Buffer.alloc(0),
      frame(SHOW, Buffer.alloc(4)),
      frame(SHOW, Buffer.alloc(8), { length: 4000000000 }),
    ],
    magic: [frame(SHOW, Buffer.alloc(8), { magic: 1 })],
    version: [frame(SHOW, Buffer.alloc(8), { version: 2 }), frame(SHOW, Buffer.alloc(8), { version: 0 })],
    type: [frame(2, Buffer.alloc(8)), frame(65535, Buffer.alloc(0)), "text"],
    content: [
      frame(SHOW, nan),
      show(1 << 30),
      show(0, -1),
      frame(MESSAGE, text(["", "key", ""])),
      frame(MESSAGE, text(["hand", "k\x07", ""])),
      frame(MESSAGE, text(["x".repeat(64), "k", ""])),
    ],
  };
  for (const frames of Object.values(bad)) for (const each of frames) one.socket.send(each);
  for (const [reason, frames] of Object.entries(bad))
    await until(
      `${frames.length} refused for ${reason}`,
      async () => (await one.state()).refused[reason] === before[reason] + frames.length,
    );
  const seen = one.count.get(10) ?? 0;
  await until("status goes on", () => (one.count.get(10) ?? 0) > seen + 2);
  one.socket.send(Buffer.alloc(1 << 20)); // a huge message closes the connection
  await one.closed;
  const other = await client();
  assert.equal((await other.state()).refused.size, before.size + bad.size.length + 1);
  await leave(other);
});

test("a module answers that a key is unknown", async () => {
  const one = await client();
  const answers = [];
  one.socket.on("message", (data) => {
    for (let at = 0; at < data.length; at += 16 + data.readUInt32LE(at + 8)) {
      if (data.readUInt16LE(at + 6) !== 11) continue;
      const [module, text] = [data.subarray(at + 32, at + 96), data.subarray(at + 96, at + 224)].map((field) =>
        field.toString("latin1").replaceAll("\0", ""),
      );
      if (module === "viewer") answers.push(`${data.readBigUInt64LE(at + 16)} ${text}`);
    }
  });
  one.socket.send(show(1 << 11));
  await pause(1000);
  for (const [id, module] of [
    [7n, "viewer"],
    [8n, "other"],
  ]) {
    const payload = Buffer.alloc(8 + 3 * 64);
    payload.writeBigUInt64LE(id);
    [module, "gain", "1"].forEach((text, i) => payload.write(text, 8 + 64 * i, "latin1"));
    one.socket.send(frame(MESSAGE, payload));
  }
  await until("both answers", () => answers.length === 2);
  assert.match(answers[0], /^7 unknown key/);
  assert.match(answers[1], /^8 not for this module/);
  await leave(one);
});

test("an object file that comes late is used with the next description", async () => {
  const folder = mkdtempSync(`${tmpdir()}/softhand_viewer_`);
  copyFileSync(`${tree}/config/scenes/pinch.toml`, `${folder}/pinch.toml`);
  const settings = ["viewer.port=0", `hand.model=${tree}/config/hands/right_400.hand.json`];
  const late = new Process(
    `${build}/bin/softhand-viewer`,
    ...["--config", `${folder}/pinch.toml`],
    ...settings.flatMap((setting) => ["--set", setting]),
  );
  const [, url] = await late.line(/see it at (\S+)/);
  const one = new Client(url);
  await one.opened;
  one.socket.send(show(1 << 14));
  await one.state();
  const tell = (value) => one.socket.send(message("*", "ball", value));
  tell("unknown");
  await late.line(/object 'late_ball' refused/);
  tell("unknown again");
  await source.line(/message \* ball unknown again/);
  await pause(500);
  assert.equal(late.output.split("object 'late_ball' refused").length, 2, "it is said once");
  assert.equal(one.count.get(14), undefined);
  copyFileSync(`${tree}/config/objects/sponge_ball.object.json`, `${folder}/late_ball.object.json`);
  tell("unknown");
  await until("the object", () => one.count.get(14) === 1);
  tell("removed");
  await leave(one);
  await late.end();
  rmSync(folder, { recursive: true });
});

test("a page that keeps sending bad frames is disconnected", async () => {
  const one = await client();
  for (let i = 0; i < 200; ++i) one.socket.send(Buffer.alloc(20));
  await one.closed;
});

test("other origins and other names for this host are refused", async () => {
  const refused = (options) => assert.rejects(new Client(viewer.url, options).opened, /403/);
  await refused({ origin: "http://evil.example" });
  await refused({ origin: `http://evil.example:${viewer.port}`, headers: { host: `evil.example:${viewer.port}` } });
  await refused({ origin: `http://127.0.0.1:${viewer.port + 1}` });
  const same = new Client(viewer.url, { origin: viewer.url });
  await same.opened;
  assert.ok((await same.state()).refused.origin >= 3);
  await leave(same);
});

// An address other than localhost. A connection to it comes from it.
const lan = Object.values(networkInterfaces())
  .flat()
  .find(({ family, internal }) => family === "IPv4" && !internal)?.address;
test("programs of other machines need the token to send messages", { skip: !lan && "no other address" }, async () => {
  const open = await gateway(0, "viewer.address=0.0.0.0", `viewer.hosts=${lan}`, "viewer.token=sesame");
  await open.process.line(new RegExp(`elsewhere at http://${lan}:${open.port}/\\?token=sesame`));
  const answers = async (url, options, query) => {
    const one = new Client(url, options, query);
    await one.opened;
    one.socket.send(show(STATUS | (1 << 11)));
    await one.state();
    const id = BigInt(Math.floor(1e9 * Math.random()));
    one.socket.send(message("viewer", "no such key", "1", id));
    const isIt = ([key, payload]) => key.startsWith("11 ") && payload.readBigUInt64LE(0) === id;
    const [, payload] = await until("a reply", () => [...one.newest].find(isIt));
    const { refused } = await one.state();
    await leave(one);
    return { result: payload.readUInt32LE(8), text: payload.subarray(80).toString(), refused: refused.token };
  };
  const away = `http://${lan}:${open.port}`;
  const named = { headers: { host: `localhost:${open.port}` } };
  for (const [options, query] of [[{}, ""], [named, ""], [{}, "?token=guess"]]) {
    const { result, text } = await answers(away, options, query);
    assert.equal(result, 2);
    assert.match(text, /need the token/);
  }
  assert.equal((await answers(away, {}, "?token=sesame")).result, 0, "the module ignores an unknown key");
  const here = await answers(open.url, {}, "");
  assert.equal(here.result, 0, "programs of this machine need no token");
  assert.equal(here.refused, 3);
  await open.process.end();
});

test("a response gets its full time after the connection was idle for long", () => slowResponse);
