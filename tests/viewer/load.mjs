// node load.mjs HAND_FILE CLIENTS SECONDS: what the gateway costs with so many pages that show the skin, contacts, objects and status. Prints JSON.
// Environment as for the tests (harness.mjs).
import { readFileSync } from "node:fs";
import { Client, Process, gateway, pause, show, source, build, until } from "./harness.mjs";

const [hand = `${source}/config/hands/right_1450.hand.json`, clients = 3, seconds = 10] = process.argv.slice(2);
const cpu = (one) =>
  readFileSync(`/proc/${one.child.pid}/stat`, "latin1")
    .split(") ")[1]
    .split(" ")
    .slice(11, 13)
    .reduce((sum, ticks) => sum + Number(ticks), 0) / 100;

const publisher = new Process(`${build}/tests/viewer/viewer_publisher`, hand);
const viewer = await gateway();
const pages = Array.from({ length: Number(clients) }, () => new Client(viewer.url));
await Promise.all(pages.map((page) => page.opened));
for (const page of pages) page.socket.send(show((1 << 1) | (1 << 2) | (1 << 6) | (1 << 7) | (1 << 8) | (1 << 10)));
await until("nodes", () => pages.every((page) => page.count.get(2) > 10));
const before = { cpu: cpu(viewer.process), nodes: pages.map((page) => page.count.get(2)), bytes: pages.map((page) => page.bytes) };
await pause(1000 * seconds);
const result = {
  hand,
  nodes: pages[0].frames.get(2).readUInt32LE(36),
  skin_vertices: pages[0].frames.get(1).readUInt32LE(4),
  pages: pages.length,
  node_frames_per_second: pages.map((page, i) => (page.count.get(2) - before.nodes[i]) / seconds),
  kilobytes_per_second_and_page: pages.map((page, i) => Math.round((page.bytes - before.bytes[i]) / seconds / 1000)),
  gateway_cpu_percent: (100 * (cpu(viewer.process) - before.cpu)) / seconds,
};
console.log(JSON.stringify(result, null, 1));
for (const page of pages) page.socket.terminate();
await Promise.all([publisher.end(), viewer.process.end()]);
process.exit(0);
