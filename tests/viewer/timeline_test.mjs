// Tests of the page's timeline of the stream and of files. The module runs alone, without a browser, on a clock of the
// test.
import assert from "node:assert/strict";
import { createRequire } from "node:module";
import { test } from "node:test";
import { build, source } from "./harness.mjs";

const { buildSync } = createRequire(`${build}/services/viewer/page/work/`)("esbuild");
const { outputFiles } = buildSync({
  entryPoints: [`${source}/services/viewer/page/src/timeline.ts`],
  bundle: true,
  format: "esm",
  write: false,
});
const { Timeline } = await import(
  `data:text/javascript;base64,${Buffer.from(outputFiles[0].contents).toString("base64")}`
);

const [HAND, NODES, CONTACTS, OBJECT, STATUS] = [1, 2, 6, 8, 10];
/** A frame whose payload is the number `value`. */
function frame(type, value, instance = 1) {
  const bytes = Buffer.alloc(24);
  [0x46564853, 3 | (type << 16), 8, instance].forEach((word, i) => bytes.writeUInt32LE(word, 4 * i));
  bytes.writeDoubleLE(value, 16);
  return { type, instance, payload: new DataView(bytes.buffer, bytes.byteOffset + 16, 8) };
}
const text = ({ type, payload }) => `${type}:${payload.getFloat64(0, true)}`;

/** A timeline, the frames that it showed since the last `look`, and a source of `streams` at 60 Hz. */
function player(streams = [NODES]) {
  const made = { shown: [], now: 0, sent: 0 };
  made.timeline = new Timeline(
    (each) => made.shown.push(text(each)),
    () => {},
    () => made.shown.push("clear"),
  );
  made.look = () => made.shown.splice(0);
  made.run = (seconds) => {
    for (let i = 0; i < 60 * seconds; ++i) {
      made.now += 1000 / 60;
      ++made.sent;
      for (const type of streams) made.timeline.add(made.now, frame(type, made.sent));
      made.timeline.advance(made.now, 1000 / 60);
    }
  };
  return made;
}
/** The frames of a saved file in their order. */
async function saved(timeline) {
  const file = await timeline.save().arrayBuffer();
  const view = new DataView(file);
  const frames = [];
  for (let at = 8; at < file.byteLength; at += 12 + view.getUint32(at + 8, true))
    frames.push(`${view.getUint16(at + 12 + 6, true)}:${view.getFloat64(at + 12 + 16, true)}`);
  return { file, frames };
}

test("a long pause keeps the samples around the paused picture", async () => {
  const player1 = player([NODES, CONTACTS]);
  const { timeline, run, look } = player1;
  run(20);
  timeline.paused = true;
  run(5);
  const early = (await saved(timeline)).frames.length;
  run(300);
  assert.ok(
    (await saved(timeline)).frames.length < early + 2 * 60 * 15,
    `${(await saved(timeline)).frames.length} frames are kept after five minutes, ${early} after five seconds`,
  );
  look();
  timeline.step(1);
  assert.ok(look().includes(`${NODES}:1201`), "a step must show the sample that follows the paused one");
  timeline.goLive();
  look();
  run(1 / 60);
  assert.ok(look().includes(`${NODES}:${player1.sent}`), "live mode must show the newest sample");
});

test("an opened file is saved with its own descriptions", async () => {
  const [one, other] = [player(), player()];
  one.timeline.add(0, frame(HAND, 100));
  one.run(1);
  const { file, frames } = await saved(one.timeline);
  other.timeline.add(0, frame(HAND, 200));
  other.run(1);
  other.timeline.open(file);
  assert.deepEqual((await saved(other.timeline)).frames, frames);
});

test("module status is shown while a file plays", async () => {
  const { timeline, run, look } = player();
  run(1);
  timeline.open((await saved(timeline)).file);
  look();
  timeline.add(2000, frame(STATUS, 5));
  assert.deepEqual(look(), [`${STATUS}:5`]);
});

test("frames of a file and live frames are not mixed", async () => {
  const [recorded, now] = [player(), player([NODES, CONTACTS])];
  recorded.timeline.add(0, frame(HAND, 100));
  recorded.run(1);
  now.timeline.add(0, frame(HAND, 200));
  now.timeline.add(0, frame(OBJECT, 300));
  now.run(1);
  now.look();
  now.timeline.open((await saved(recorded.timeline)).file);
  assert.deepEqual(now.look(), ["clear", `${HAND}:100`]);
  now.run(0.5);
  now.look();
  now.timeline.goLive();
  // A halted simulation sends no further frames.
  now.timeline.advance(now.now, 0);
  assert.deepEqual(now.look(), ["clear", `${HAND}:200`, `${OBJECT}:300`, `${NODES}:90`, `${CONTACTS}:90`]);
});

test("a step back shows another sample of the hand, or of skeletons if only these are shown", () => {
  const TRACKED = 3;
  for (const streams of [[NODES, CONTACTS], [TRACKED, CONTACTS]]) {
    const { timeline, run, look } = player(streams);
    run(3);
    timeline.paused = true;
    for (const [direction, sample] of [[-1, 179], [-1, 178], [1, 179], [1, 180]]) {
      look();
      timeline.step(direction);
      assert.ok(look().includes(`${streams[0]}:${sample}`), `${streams} ${direction} to ${sample}`);
    }
  }
});

test("frames of a new stream are not mixed with earlier frames, and a paused picture stays", async () => {
  const { timeline, run, look } = player();
  timeline.add(0, frame(HAND, 100));
  run(1);
  look();
  timeline.forget();
  timeline.add(1000, frame(OBJECT, 300));
  run(1 / 60);
  assert.deepEqual(look(), ["clear", `${OBJECT}:300`, `${NODES}:61`]);
  timeline.paused = true;
  timeline.forget();
  timeline.add(1100, frame(HAND, 200));
  run(1);
  assert.deepEqual(look(), []);
  assert.equal((await saved(timeline)).frames[0], `${OBJECT}:300`);
  timeline.paused = false;
  run(1 / 60);
  assert.deepEqual(look(), ["clear", `${HAND}:200`, `${NODES}:122`]);
  assert.deepEqual((await saved(timeline)).frames, [`${HAND}:200`, `${NODES}:122`]);
});

test("a truncated file or a file with a time that is not finite is refused, and the picture stays", async () => {
  const { timeline, run, look } = player();
  timeline.add(0, frame(HAND, 100));
  run(1);
  const { file } = await saved(timeline);
  look();
  const length = 12 + 24;
  for (const cut of [length - 1, 11, 1])
    assert.throws(
      () => timeline.open(file.slice(0, file.byteLength - length + cut)),
      /cut off/,
      `${cut} bytes of the last frame`,
    );
  for (const time of [NaN, Infinity]) {
    const broken = file.slice(0);
    new DataView(broken).setFloat64(8 + 30 * length, time, true);
    assert.throws(() => timeline.open(broken), /time/);
  }
  assert.deepEqual(look(), []);
});

test("invented objects and hands do not grow the timeline", async () => {
  const { timeline, look } = player();
  for (let i = 0; i < 3000; ++i) {
    timeline.add(0, frame(OBJECT, i, i));
    timeline.add(0, frame(NODES, i, i));
  }
  look();
  timeline.open(await timeline.save().arrayBuffer());
  assert.equal(look().filter((each) => each.startsWith(`${OBJECT}:`)).length, 1024);
  timeline.goLive();
  timeline.advance(0, 0);
  assert.equal(look().filter((each) => each.startsWith(`${NODES}:`)).length, 1024);
});
