// A session in an emulated headset (iwer): its hand reaches tracked_skeleton by way of page and softhand-tracker-webxr, in the world's frame.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { Client, Process, browser, build, gateway, pause, show, source, until } from "./harness.mjs";

const TRACKED = 3;
const WRIST = 1;
const JOINT_BYTES = 36;
// The head looks along the room's -X, so that the world's axes differ from the room's: world +X is room -Z, world +Z is room +X.
const HEAD = [0.3, 1.5, 0.2];
const ORIGIN = [HEAD[0] - 0.4, HEAD[1] - 0.45, HEAD[2]];

let chromium, viewer, tracker, page, client;
const errors = [];

before(async () => {
  tracker = new Process(`${build}/bin/softhand-tracker-webxr`, "--config", `${source}/config/scenes/demo.toml`, "--set", "tracker_webxr.port=0");
  const [, port] = await tracker.line(/listening at ws:\S+:(\d+)/);
  viewer = await gateway();
  client = new Client(viewer.url);
  await client.opened;
  client.socket.send(show(1 << TRACKED));
  chromium = await browser();
  page = await chromium.newPage({ viewport: { width: 480, height: 320 } });
  page.on("pageerror", (error) => errors.push(String(error)));
  await page.addInitScript({ path: `${build}/services/viewer/page/work/node_modules/iwer/build/iwer.min.js` });
  await page.addInitScript((head) => {
    const device = (window.emulated = new window.IWER.XRDevice(window.IWER.metaQuest3));
    device.installRuntime({ forceInstall: true });
    // iwer 2.5.0 takes a matrix here; pages give an XRRigidTransform, as the standard says.
    const { prototype } = XRReferenceSpace;
    const byMatrix = prototype.getOffsetReferenceSpace;
    prototype.getOffsetReferenceSpace = function (offset) {
      return byMatrix.call(this, offset.matrix);
    };
    device.primaryInputMode = "hand";
    device.position.set(...head);
    device.quaternion.set(0, Math.SQRT1_2, 0, Math.SQRT1_2);
    device.hands.left.connected = false;
  }, HEAD);
  await page.goto(`${viewer.url}?quality=low&tracker=${port}`);
});
after(async () => {
  client?.socket.terminate();
  await chromium?.close();
  await Promise.all([...Process.all].map((process) => process.end("SIGKILL")));
});

const samples = () => client.count.get(TRACKED) ?? 0;
const session = () => page.evaluate(() => document.documentElement.dataset.session ?? null);
/** The wrist that is tracked, world, once the hand has been at `position` (room) for some samples. */
async function wristAt(position) {
  await page.evaluate((to) => window.emulated.hands.right.position.set(...to), position);
  // Late ones of before are passed over: those that were on their way, and what the page drew meanwhile.
  const drawn = (await page.evaluate(() => window.softhand.counts.drawn)) + 3;
  await until("pictures in the headset", () => page.evaluate((n) => window.softhand.counts.drawn >= n, drawn), 60);
  const seen = samples() + 3;
  await until("tracked_skeleton", () => samples() >= seen, 60);
  const payload = client.frames.get(TRACKED);
  assert.equal(payload.readUInt32LE(28), 0, "world frame");
  const at = 32 + WRIST * JOINT_BYTES;
  assert.notEqual(payload.readUInt32LE(at + 32), 0, "the wrist is valid");
  return [0, 1, 2].map((axis) => payload.readFloatLE(at + 4 * axis));
}
function near(actual, expected, tolerance, what) {
  actual.forEach((value, axis) => assert.ok(Math.abs(value - expected[axis]) < tolerance, `${what}: ${actual}, expected ${expected}`));
}

test("a headset's browser is offered its sessions", async () => {
  await page.locator("#enter-vr").waitFor({ state: "visible" });
  await page.locator("#enter-ar").waitFor({ state: "visible" });
  assert.equal(samples(), 0);
});

for (const mode of ["vr", "ar"]) {
  test(`the hand of an ${mode} session is tracked where it is before the user`, async () => {
    await page.reload(); // iwer leaves the canvas in front of the page's buttons after a session.
    await page.click(`#enter-${mode}`);
    await until("a session", async () => (await session()) === `immersive-${mode}`);
    const first = await wristAt(ORIGIN);
    near(first, [0, 0, 0], 0.15, "a hand where the world's origin is put");
    const moved = await wristAt([ORIGIN[0] + 0.1, ORIGIN[1] + 0.05, ORIGIN[2] - 0.02]);
    near(
      moved.map((value, axis) => value - first[axis]),
      [0.02, 0.05, 0.1],
      1e-4,
      "its way",
    );
  });

  test(`the page goes on after the ${mode} session, the tracker hears no more`, async () => {
    await page.evaluate(() => window.emulated.activeSession.end());
    await until("the end", async () => (await session()) === null);
    await pause(300);
    const seen = samples();
    const drawn = await page.evaluate(() => window.softhand.counts.drawn);
    await until("pictures in the page", () => page.evaluate((n) => window.softhand.counts.drawn > n + 3, drawn), 60);
    assert.equal(samples(), seen);
  });
}

test("nothing went wrong on the way", async () => assert.deepEqual(errors, []));

test("a browser without a headset offers none", async () => {
  await page.close(); // Its drawing would slow the other's down.
  const plain = await chromium.newPage();
  await plain.goto(viewer.url);
  await until("pictures", () => plain.evaluate(() => window.softhand?.counts.drawn > 2), 60);
  assert.ok(await plain.locator("#enter-vr").isHidden());
  assert.ok(await plain.locator("#enter-ar").isHidden());
});
