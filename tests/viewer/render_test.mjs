// Tests of the pictures that `softhand render` makes.
import assert from "node:assert/strict";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, test } from "node:test";
import { Process, build, source } from "./harness.mjs";

const folder = mkdtempSync(join(tmpdir(), "softhand_render_"));
after(() => rmSync(folder, { recursive: true }));

async function render(name, ...more) {
  const out = join(folder, name);
  const hand = ["--hand", "right_400.hand.json"];
  const process = new Process(
    `${build}/bin/softhand`,
    "render",
    `${source}/config/scenes/pinch_lift.toml`,
    ...hand,
    "--out",
    out,
    "--width",
    "160",
    "--height",
    "100",
    ...more,
  );
  assert.equal(await process.ended, 0, process.output);
  Process.all.delete(process);
  return readFileSync(out);
}
/** The chunks of a PNG file by type. */
function chunks(png) {
  const found = {};
  for (let at = 8; at < png.length; at += 12 + png.readUInt32BE(at))
    (found[png.toString("latin1", at + 4, at + 8)] ??= []).push(png.subarray(at + 8, at + 8 + png.readUInt32BE(at)));
  return found;
}

test("a picture has the requested size and shows the hand", async () => {
  const png = await render("still.png", "--at", "0.5");
  const { IHDR } = chunks(png);
  assert.deepEqual([IHDR[0].readUInt32BE(0), IHDR[0].readUInt32BE(4)], [160, 100]);
  assert.ok(png.length > 3000, "the picture must not be empty");
  const other = await render("other.png", "--at", "0.5", "--view", "show=floor,objects");
  assert.notDeepEqual(png, other, "the picture without the hand must differ");
});

test("an animation has the requested frames, and they differ", async () => {
  const { acTL, fcTL, fdAT } = chunks(await render("moving.png", "--at", "0.8", "--seconds", "1.2", "--rate", "2.5"));
  assert.equal(acTL[0].readUInt32BE(0), 3);
  assert.equal(fcTL.length, 3);
  for (const control of fcTL) assert.equal(control.readUInt16BE(20) / control.readUInt16BE(22), 0.4);
  for (const change of fdAT) assert.ok(change.length > 300, `${change.length} bytes changed`);
});

test("a file that is no scene is refused", async () => {
  const process = new Process(
    `${build}/bin/softhand`,
    "render",
    `${source}/config/rigs/demo.toml`,
    "--out",
    join(folder, "none.png"),
  );
  assert.equal(await process.ended, 1);
  Process.all.delete(process);
});
