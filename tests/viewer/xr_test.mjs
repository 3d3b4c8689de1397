// Tests of a session in an emulated headset (iwer). The poses of hands and head go through the page and
// softhand-tracker-webxr. They must arrive in tracked_skeleton and head_pose, in the world's frame.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { Client, Process, browser, build, gateway, message, pause, recorded, show, source, until } from "./harness.mjs";

const TRACKED = 3;
const WRIST = 1;
const JOINT_BYTES = 36;
// The head looks along the room's -X, so that the axes of world and room differ. World +X is room -Z, and world +Z is
// room +X.
const HEAD = [0.3, 1.5, 0.2];
const ORIGIN = [HEAD[0] - 0.4, HEAD[1] - 0.45, HEAD[2]];
const HEAD_IN_WORLD = [0, 0.45, 0.4];
const SIDES = { left: 0, right: 1 }; // instances of user 0's hands

let chromium, viewer, tracker, page, client;
const errors = [];

before(async () => {
  tracker = new Process(
    `${build}/bin/softhand-tracker-webxr`,
    "--config",
    `${source}/config/scenes/pinch.toml`,
    "--set",
    "tracker_webxr.port=0",
  );
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
    // iwer 2.5.0 expects a matrix here. Pages pass an XRRigidTransform, as the standard requires.
    const { prototype } = XRReferenceSpace;
    const byMatrix = prototype.getOffsetReferenceSpace;
    prototype.getOffsetReferenceSpace = function (offset) {
      return byMatrix.call(this, offset.matrix);
    };
    device.primaryInputMode = "hand";
    device.position.set(...head);
    device.quaternion.set(0, Math.SQRT1_2, 0, Math.SQRT1_2);
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
/** The tracked wrist (world) after the hand of `side` has been at `position` (room) for some samples. */
async function wristAt(side, position) {
  await page.evaluate(([side, to]) => window.emulated.hands[side].position.set(...to), [side, position]);
  // Skips old samples: those on their way, and those of pictures that the page draws meanwhile.
  const drawn = (await page.evaluate(() => window.softhand.counts.drawn)) + 3;
  await until("pictures in the headset", () => page.evaluate((n) => window.softhand.counts.drawn >= n, drawn), 60);
  const seen = samples() + 6; // of both hands
  await until("tracked_skeleton", () => samples() >= seen, 60);
  const payload = client.newest.get(`${TRACKED} ${SIDES[side]}`);
  assert.equal(payload.readUInt32LE(28), 0, "world frame");
  const at = 32 + WRIST * JOINT_BYTES;
  assert.notEqual(payload.readUInt32LE(at + 32), 0, "the wrist must be valid");
  return [0, 1, 2].map((axis) => payload.readFloatLE(at + 4 * axis));
}
function near(actual, expected, tolerance, what) {
  actual.forEach((value, axis) =>
    assert.ok(Math.abs(value - expected[axis]) < tolerance, `${what}: ${actual}, expected ${expected}`),
  );
}

test("a headset's browser shows the buttons of its sessions", async () => {
  await page.locator("#enter-vr").waitFor({ state: "visible" });
  await page.locator("#enter-ar").waitFor({ state: "visible" });
  assert.equal(samples(), 0);
});

for (const mode of ["vr", "ar"]) {
  test(`the hands of an ${mode} session are tracked at their place in front of the user`, async () => {
    await page.reload(); // After a session, iwer leaves the canvas in front of the page's buttons.
    await page.click(`#enter-${mode}`);
    await until("a session", async () => (await session()) === `immersive-${mode}`);
    for (const side of Object.keys(SIDES)) {
      const first = await wristAt(side, ORIGIN);
      near(first, [0, 0, 0], 0.15, `the ${side} hand at the world's origin`);
      const moved = await wristAt(side, [ORIGIN[0] + 0.1, ORIGIN[1] + 0.05, ORIGIN[2] - 0.02]);
      near(
        moved.map((value, axis) => value - first[axis]),
        [0.02, 0.05, 0.1],
        1e-4,
        `movement of the ${side} hand`,
      );
    }
  });

  test(`the head of an ${mode} session is published`, async () => {
    const poses = await recorded("softhand/v1/head_pose", 2);
    assert.ok(poses.length > 3, `${poses.length} samples`);
    const pose = poses.at(-1);
    assert.equal(pose.readUInt32LE(0), 0, "user");
    assert.equal(pose.readUInt32LE(144), 1, "valid");
    near([88, 96, 104].map((at) => pose.readDoubleLE(at)), HEAD_IN_WORLD, 1e-4, "position");
    const orientation = [112, 120, 128].map((at) => pose.readDoubleLE(at));
    near(orientation, [0, 0, 0], 1e-4, "orientation: the head looks along the world's -Z");
  });

  test(`a prompt is on a sign in an ${mode} session`, async () => {
    const sign = () => page.evaluate(() => window.softhand.signIsVisible());
    assert.equal(await sign(), false);
    client.socket.send(message("viewer", "prompt", "600 Make a fist"));
    await until("the sign", sign, 60);
    client.socket.send(message("viewer", "prompt", "0 "));
    await until("no sign", async () => !(await sign()), 60);
  });

  test(`recentring in an ${mode} session puts the world in front of the user again`, async () => {
    const first = await wristAt("right", ORIGIN);
    // The head moves above the room's origin and turns to the room's -Z. The world follows the head, so the hand must
    // move to the world's new origin.
    await page.evaluate(() => window.emulated.recenter());
    const head = await page.evaluate(() => {
      const { x, y, z } = window.emulated.position;
      return [x, y, z];
    });
    near(head, [0, HEAD[1], 0], 1e-6, "iwer's head");
    const again = await wristAt("right", [0, HEAD[1] - 0.45, -0.4]);
    near(again, first, 1e-3, "the hand at the new origin");
    await page.evaluate((position) => {
      window.emulated.position.set(...position);
      window.emulated.quaternion.set(0, Math.SQRT1_2, 0, Math.SQRT1_2);
    }, HEAD);
  });

  test(`after the ${mode} session the page goes on drawing and the tracker gets no samples`, async () => {
    await page.evaluate(() => window.emulated.activeSession.end());
    await until("the end", async () => (await session()) === null);
    await pause(300);
    const seen = samples();
    const drawn = await page.evaluate(() => window.softhand.counts.drawn);
    await until("pictures in the page", () => page.evaluate((n) => window.softhand.counts.drawn > n + 3, drawn), 60);
    assert.equal(samples(), seen);
  });
}

test("the page threw no error during these tests", async () => assert.deepEqual(errors, []));

test("a browser without a headset shows no session button", async () => {
  await page.close(); // Its drawing would slow down the other page.
  const plain = await chromium.newPage();
  await plain.goto(viewer.url);
  await until("pictures", () => plain.evaluate(() => window.softhand?.counts.drawn > 2), 60);
  assert.ok(await plain.locator("#enter-vr").isHidden());
  assert.ok(await plain.locator("#enter-ar").isHidden());
});
