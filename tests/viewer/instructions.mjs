// node instructions.mjs [PAGES] [SECONDS] [HAND_FILE] (3, 60, right_400) measures the cost of pages for the hand's
// service and prints JSON. It counts the service's instructions per step while two fingers rest on a post, in three
// cases.
// - Only the world reads the service's data.
// - A status reader is added, as in `softhand up`.
// - PAGES pages that show everything are added.
//
// Callgrind counts the instructions (apt-get install valgrind), so the rig runs at a hundredth of its pace. Each case
// takes SECONDS of real time and one more minute. The environment is that of the tests (harness.mjs).
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, readdirSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { Client, MESSAGE, Process, build, frame, gateway, pause, show, source, until } from "./harness.mjs";

const [pages = 3, seconds = 60, handFile = `${source}/config/hands/right_400.hand.json`] = process.argv.slice(2);
const scene = `${source}/tests/integration/rig_touch_scene.toml`;
const EVERYTHING = (1 << 12) - 2; // all types that a page can request
const STATUS = 1 << 10;
const NODES = 2;
const CONTACTS = 6;
const CONTACT_COUNT_AT = 24 + 6 * 52; // in the payload of contacts
const RATE = 90; // Hz, of the hand
const STATUS_RATE = 10; // Hz, by the real clock
const PACE = 0.01; // the slowest pace
const SETTLE = 20; // s between a change of the readers and the count; covers discovery and some steps

const quiet = ["tracker.position_noise=0", "tracker.rotation_noise=0"]; // each step does the same work
// The large work budget keeps the slow run under callgrind from ending a step early.
const settings = [...quiet, "hand.simulation.solver.work_budget=1000", `hand.model=${handFile}`].flatMap((setting) => [
  "--set",
  setting,
]);
const folder = mkdtempSync(`${tmpdir()}/softhand_callgrind_`);

/**
 * Calls of functions that match `pattern` from functions that match `by`, in the lines of a dump: their number, and
 * their instructions including all callees.
 */
function inclusive(lines, pattern, by = /./) {
  const names = new Map();
  const sum = { calls: 0, instructions: 0 };
  let caller = "";
  let callee = "";
  for (let i = 0; i < lines.length; ++i) {
    const name = /^(c?)fn=(\(\d+\))(?: (.*))?$/.exec(lines[i]);
    if (name) {
      if (name[3]) names.set(name[2], name[3]);
      if (name[1]) callee = names.get(name[2]) ?? "";
      else caller = names.get(name[2]) ?? "";
    }
    const calls = /^calls=(\d+)/.exec(lines[i]);
    if (!calls) continue;
    ++i; // the next line has the call's line number and its cost
    if (!pattern.test(callee) || !by.test(caller)) continue;
    sum.calls += Number(calls[1]);
    sum.instructions += Number(lines[i].split(" ").at(-1));
  }
  return sum;
}

/**
 * Instructions per step of the service and of its parts. The status is published by the real clock, so its share of a
 * step is converted to full pace.
 */
function readDump(path) {
  const lines = readFileSync(path, "latin1").split("\n");
  const main = /::run\(int, char\*\*\)::\{lambda\(long\)#\d+\}>::_M_invoke/;
  const write = /^softhand::bus::detail::WriterEndpoint::write\(/;
  const { calls } = inclusive(lines, /^softhand::HandLoop::step\(/);
  const status = inclusive(lines, /::run\(int, char\*\*\)::\{lambda\(softhand::LoopStatus&, long\)#\d+\}>::_M_invoke/);
  const told = inclusive(lines, write, /Service::run/);
  const perStatus = status.calls === 0 ? 0 : (status.instructions + told.instructions) / status.calls;
  const perStep = (pattern, by) => Math.round(inclusive(lines, pattern, by).instructions / calls);
  return {
    steps: calls,
    instructions_per_step: Math.round(perStep(main) + (perStatus * STATUS_RATE) / RATE),
    solver: perStep(/^softhand::HandSimulation::step\(/),
    outputs: perStep(/^softhand::HandLoop::write_outputs\(/),
    publishing: perStep(write, main),
    one_status: Math.round(perStatus),
  };
}

const start = (program, ...more) => new Process(`${build}/bin/${program}`, "--config", scene, ...settings, ...more);
const viewer = await gateway();
start("softhand-world");
const callgrind = ["--tool=callgrind", "--instr-atstart=no", `--callgrind-out-file=${folder}/out`];
const hand = new Process("valgrind", ...callgrind, `${build}/bin/softhand-hand`, "--config", scene, ...settings);
start("softhand-tracking");
// The fingers rest on the post from 1.2 s of the motion on.
start("softhand-tracker-replay", "--set", "tracker.start_time=1.3");
// A page that shows nothing sends the commands, because the hand already knows the page's gateway.
const steering = new Client(viewer.url);
await steering.opened;
function setPace(pace) {
  const payload = Buffer.alloc(8 + 3 * 64);
  ["*", "pace", String(pace)].forEach((text, i) => payload.write(text, 8 + 64 * i, "latin1"));
  steering.socket.send(frame(MESSAGE, payload));
}
steering.socket.send(show(1 << NODES));
await until("the hand", () => steering.count.get(NODES) > 2, 300);
steering.socket.send(show(0));
await pause(3000 * SETTLE); // until the fingers on the post are at rest
setPace(PACE);
await pause(4000 * SETTLE); // about seventy steps, because many steps were missed before
for (const one of Process.all)
  one.ended.then(() => {
    console.error(one.output);
    process.exit(1);
  });

const control = (...options) =>
  execFileSync("callgrind_control", [...options, String(hand.child.pid)], { stdio: "ignore" });
/** Calls `run` between whole steps, because a call in progress at the start or end of counting is counted wrongly. */
async function halted(run) {
  setPace(0);
  await pause(5000);
  run();
  // A process that is busy for two seconds refuses a command as too old. Callgrind may be so slow at first, so the
  // command is repeated.
  for (let i = 0; i < 3; ++i) {
    await pause(3000);
    setPace(PACE);
  }
}
const turns = [];
for (const [read, count, types] of [
  ["nothing", 0, 0],
  ["status", 1, STATUS],
  ["everything", Number(pages), EVERYTHING],
]) {
  const clients = Array.from({ length: count }, () => new Client(viewer.url));
  await Promise.all(clients.map((client) => client.opened));
  for (const client of clients) client.socket.send(show(types));
  await pause(1000 * SETTLE);
  if (types === EVERYTHING)
    for (const client of clients) {
      await until("nodes", () => client.count.get(NODES) > 2, 120);
      if (client.frames.get(CONTACTS).readUInt32LE(CONTACT_COUNT_AT) === 0)
        throw new Error("the fingers do not touch the post");
    }
  await halted(() => control("-i", "on"));
  await pause(1000 * seconds);
  await halted(() => control("-d"));
  await halted(() => control("-i", "off"));
  const [dump] = readdirSync(folder).sort((a, b) => Number(b.split(".")[1] ?? 0) - Number(a.split(".")[1] ?? 0));
  const counted = readDump(`${folder}/${dump}`);
  if (!(counted.steps > 5 && counted.steps < 2 * RATE * PACE * (Number(seconds) + 30)))
    throw new Error(`${counted.steps} steps: the hand does not keep the pace`);
  turns.push({ read, pages: count, ...counted });
  for (const client of clients) client.socket.terminate();
}
const [nothing, status, everything] = turns.map((turn) => turn.instructions_per_step);
const ratios = { pages_over_status: everything / status, pages_over_nothing: everything / nothing };
console.log(JSON.stringify({ hand: handFile, turns, ...ratios }, null, 1));
rmSync(folder, { recursive: true });
process.exit(0);
