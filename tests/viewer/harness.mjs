// Processes, browser and frames for the viewer's tests.
// Environment: SOFTHAND_BUILD (build tree), SOFTHAND_SOURCE (source tree).
import { spawn } from "node:child_process";
import { existsSync, mkdtempSync, readFileSync, rmSync } from "node:fs";
import { createRequire } from "node:module";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import { dirname } from "node:path";

export const build = process.env.SOFTHAND_BUILD;
export const source = process.env.SOFTHAND_SOURCE;
const require = createRequire(`${build}/services/viewer/page/work/`);
const { chromium } = require("playwright-core");
export const { WebSocket } = require("ws");

/** Reserves a DDS domain until this process ends, as tests/support/own_domain.hpp does. */
async function ownDomain() {
  for (let i = 0; i < 49; ++i) {
    const domain = 51 + ((process.pid + i) % 49);
    const reservation = createServer();
    const isFree = await new Promise((done) => {
      reservation.once("error", () => done(false));
      reservation.listen(20000 + domain, "127.0.0.1", () => done(true));
    });
    reservation.unref();
    if (isFree) return String(domain);
  }
  throw new Error("all domains from 51 to 99 are reserved by tests");
}
process.env.SOFTHAND_DOMAIN ??= await ownDomain();

/** Polls until `condition` returns a true value, and returns this value. */
export async function until(what, condition, seconds = 20) {
  const end = Date.now() + 1000 * seconds;
  for (;;) {
    const value = await condition();
    if (value) return value;
    if (Date.now() > end) throw new Error(`not within ${seconds} s: ${what}`);
    await new Promise((done) => setTimeout(done, 50));
  }
}
export const pause = (ms) => new Promise((done) => setTimeout(done, ms));

/** A process whose output is collected. The process ends with the test at the latest. */
export class Process {
  static all = new Set();
  static {
    process.on("exit", () => Process.all.forEach(({ child }) => child.kill("SIGKILL")));
    for (const signal of ["SIGINT", "SIGTERM"]) process.on(signal, () => process.exit(1));
  }
  output = "";
  constructor(program, ...args) {
    this.child = spawn(program, args, { stdio: ["ignore", "pipe", "pipe"] });
    for (const stream of [this.child.stdout, this.child.stderr]) stream.on("data", (text) => (this.output += text));
    this.ended = new Promise((done) => this.child.on("exit", done));
    Process.all.add(this);
  }
  line(pattern, seconds) {
    return until(`a line like ${pattern} in:\n${this.output}`, () => pattern.exec(this.output), seconds);
  }
  async end(signal = "SIGTERM") {
    this.child.kill(signal);
    await this.ended;
    Process.all.delete(this);
  }
}

export const publisher = (rate = 60) =>
  new Process(
    `${build}/tests/viewer/viewer_publisher`,
    `${source}/config/hands/right_400.hand.json`,
    "0",
    String(rate),
  );

/** Starts a gateway. Returns its process and its address. */
export async function gateway(port = 0, ...settings) {
  const overrides = [`viewer.port=${port}`, ...settings].flatMap((setting) => ["--set", setting]);
  const process = new Process(
    `${build}/bin/softhand-viewer`,
    "--config",
    `${source}/config/scenes/pinch.toml`,
    ...overrides,
  );
  const [, url] = await process.line(/see it at (\S+)/);
  return { process, url, port: Number(new URL(url).port) };
}

export async function browser(...more) {
  const executablePath = ["/usr/bin/chromium", "/usr/bin/google-chrome"].find(existsSync);
  if (!executablePath) throw new Error("no chromium: apt-get install chromium");
  const args = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-gpu-watchdog", // it would end the process that draws if this machine stalls
    ...more,
  ];
  return chromium.launch({ executablePath, args });
}

// ---- frames, implemented again from docs/viewer.md, so that an error in the page's own code shows ----

export const SHOW = 32;
export const MESSAGE = 33;
export function frame(type, payload, { magic = 0x46564853, version = 3, length = payload.length, instance = 0 } = {}) {
  const header = Buffer.alloc(16);
  header.writeUInt32LE(magic, 0);
  header.writeUInt16LE(version, 4);
  header.writeUInt16LE(type, 6);
  header.writeUInt32LE(length, 8);
  header.writeUInt32LE(instance, 12);
  return Buffer.concat([header, payload]);
}
export function show(types, rate = 0) {
  const payload = Buffer.alloc(8);
  payload.writeUInt32LE(types, 0);
  payload.writeFloatLE(rate, 4);
  return frame(SHOW, payload);
}

/** A message to a module, such as motors on. */
export function message(module, key, value, id = 1n) {
  const payload = Buffer.alloc(8 + 3 * 64);
  payload.writeBigUInt64LE(id, 0);
  [module, key, value].forEach((text, i) => payload.write(text, 8 + 64 * i));
  return frame(MESSAGE, payload);
}

/**
 * The samples published on `topic` in the next `seconds`, recorded by `softhand record`. A sample is little-endian CDR
 * without the four bytes of encapsulation.
 */
export async function recorded(topic, seconds) {
  const file = `${mkdtempSync(`${tmpdir()}/softhand_record_`)}/run.mcap`;
  await new Process(`${build}/bin/softhand`, "record", file, "--seconds", String(seconds)).ended;
  const bytes = readFileSync(file);
  rmSync(dirname(file), { recursive: true });
  const samples = [];
  let channel = -1;
  for (let at = 8; at + 9 <= bytes.length; ) {
    const size = Number(bytes.readBigUInt64LE(at + 1));
    const content = bytes.subarray(at + 9, at + 9 + size);
    if (bytes[at] === 4 && content.subarray(8, 8 + content.readUInt32LE(4)).toString() === topic)
      channel = content.readUInt16LE(0);
    if (bytes[at] === 5 && content.readUInt16LE(0) === channel) samples.push(content.subarray(22 + 4));
    at += 9 + size;
  }
  return samples;
}

/**
 * The WebSocket of a page, without a page. `frames` has the newest payload by type, `newest` has it by "type instance",
 * and `count` has the number of frames by type.
 */
export class Client {
  frames = new Map();
  newest = new Map();
  count = new Map();
  bytes = 0;
  constructor(url, options = {}, query = "") {
    this.socket = new WebSocket(`${url.replace("http", "ws")}/stream${query}`, options);
    this.opened = new Promise((done, failed) => {
      this.socket.on("open", done);
      this.socket.on("error", failed);
    });
    this.closed = new Promise((done) => this.socket.on("close", done));
    this.socket.on("message", (data) => {
      this.bytes += data.length;
      for (let at = 0; at < data.length; at += 16 + data.readUInt32LE(at + 8)) {
        const type = data.readUInt16LE(at + 6);
        const payload = data.subarray(at + 16, at + 16 + data.readUInt32LE(at + 8));
        this.frames.set(type, payload);
        this.newest.set(`${type} ${data.readUInt32LE(at + 12)}`, payload);
        this.count.set(type, (this.count.get(type) ?? 0) + 1);
      }
    });
  }
  /** The gateway's counters. */
  async state() {
    const before = this.count.get(12) ?? 0;
    await until("the gateway's state", () => (this.count.get(12) ?? 0) > before);
    const payload = this.frames.get(12);
    const names = ["none", "size", "magic", "version", "type", "content", "origin", "flood", "token"];
    return {
      epoch: payload.readBigUInt64LE(8),
      pages: payload.readUInt32LE(16),
      passedOver: payload.readDoubleLE(40),
      refused: Object.fromEntries(names.map((name, i) => [name, payload.readDoubleLE(56 + 8 * i)])),
    };
  }
}
