// node load.mjs [SECONDS] measures the viewer with hands of many nodes and prints JSON. It measures:
// - The share of 60 samples per second that reaches 0, 1 and 3 pages. Pages show skin, contacts, objects and status.
// - The gateway's processor time.
// - The pictures per second that Chromium draws of 10,000 vertices of skin.
//
// Each figure takes SECONDS (8). The environment is that of the tests (harness.mjs).
import { readFileSync } from "node:fs";
import { Client, Process, browser, build, gateway, pause, show, source, until } from "./harness.mjs";

const [seconds = 8] = process.argv.slice(2).map(Number);
const TICKS = 100; // per second, in /proc
const SHOWN = (1 << 1) | (1 << 2) | (1 << 6) | (1 << 7) | (1 << 8) | (1 << 10);
const SEQUENCE_AT = 16; // in the payload of nodes
const loads = [["right_1450"], ["right_6000", 10000]];

/** Processor time used by a process, s. */
const used = ({ child }) => {
  const fields = readFileSync(`/proc/${child.pid}/stat`, "latin1").split(") ")[1].split(" ");
  return (Number(fields[11]) + Number(fields[12])) / TICKS;
};

async function gatewayLoad(viewer, count) {
  const pages = Array.from({ length: count }, () => new Client(viewer.url));
  await Promise.all(pages.map((page) => page.opened));
  for (const page of pages) page.socket.send(show(SHOWN));
  await until("nodes", () => pages.every((page) => page.count.get(2) > 10));
  await pause(1000);
  const sequence = (page) => page.frames.get(2).readDoubleLE(SEQUENCE_AT);
  const before = {
    used: used(viewer.process),
    published: pages.map(sequence),
    nodes: pages.map((page) => page.count.get(2)),
    bytes: pages.map((page) => page.bytes),
  };
  await pause(1000 * seconds);
  const of = (now, then) => pages.map((page, i) => Number(((now(page) - then[i]) / seconds).toFixed(1)));
  const result = {
    pages: count,
    published_per_second: of(sequence, before.published)[0],
    node_frames_per_second: of((page) => page.count.get(2), before.nodes),
    kilobytes_per_second: of((page) => page.bytes / 1000, before.bytes.map((bytes) => bytes / 1000)),
    gateway_cpu_percent: Number(((100 * (used(viewer.process) - before.used)) / seconds).toFixed(1)),
  };
  const nodes = pages[0]?.frames.get(2).readUInt32LE(36);
  const skin = pages[0]?.frames.get(1).readUInt32LE(4);
  for (const page of pages) page.socket.terminate();
  await pause(1000);
  return { nodes, skin, result };
}

const out = [];
for (const [hand, ...vertices] of loads) {
  const publisher = new Process(
    `${build}/tests/viewer/viewer_publisher`,
    `${source}/config/hands/${hand}.hand.json`,
    ...vertices.map(String),
  );
  const viewer = await gateway();
  const runs = [];
  for (const count of [0, 1, 3]) runs.push(await gatewayLoad(viewer, count));
  const load = { hand, nodes: runs[1].nodes, skin_vertices: runs[1].skin, gateway: runs.map(({ result }) => result) };
  out.push(load);
  if (vertices.length > 0) {
    const chromium = await browser();
    load.chromium = [];
    for (const [width, height, query] of [
      [1280, 800, ""],
      [1280, 800, "?plain"],
      [320, 200, "?plain"],
    ]) {
      const page = await chromium.newPage({ viewport: { width, height } });
      await page.goto(`${viewer.url}${query}`);
      const counts = () => page.evaluate(() => ({ ...window.softhand?.counts, at: performance.now() }));
      await until("pictures", async () => (await counts()).drawn > 5, 120);
      const first = await counts();
      await pause(1000 * seconds);
      const last = await counts();
      const rate = (name) => Number(((1000 * (last[name] - first[name])) / (last.at - first.at)).toFixed(1));
      load.chromium.push({
        width,
        height,
        controls: query === "",
        pictures_per_second: rate("drawn"),
        node_frames_shown_per_second: rate("nodes"),
      });
      await page.close();
    }
    await chromium.close();
  }
  await Promise.all([publisher.end(), viewer.process.end()]);
}
console.log(JSON.stringify(out, null, 1));
process.exit(0);
