// node pictures.mjs [NAME]... makes the pictures of the viewer in docs/images again: all of them, or the named ones.
// All pictures of the page come from one run of the demo and show one moment while the cube is held. This takes some
// minutes without a graphics card. The environment is that of the tests (harness.mjs). deploy/pictures sets it.
import { execFileSync } from "node:child_process";
import { Process, browser, build, source, until } from "./harness.mjs";

const SECONDS = 13; // of the demo, nearly the time that the page keeps
const [wide, phone] = [{ width: 1280, height: 800 }, { width: 390, height: 844 }];
const images = `${source}/docs/images`;

const scene = `${source}/config/scenes/pinch_lift.toml`;
const rendered = {
  lift: [
    ...["--at", "1.2", "--seconds", "5", "--rate", "12", "--width", "480", "--height", "320"],
    ...["--view", "camera=-0.37,0.24,-0.33,0.01,0.1,0"],
  ],
  pressure: [
    ...["--at", "3", "--width", "960", "--height", "600"],
    ...["--view", "colour=pressure&theme=dark&show=hand&camera=-0.26,0.06,0.13,0,0.15,0.02"],
  ],
  strain: [
    ...["--at", "3", "--width", "960", "--height", "600"],
    ...["--view", "colour=strain&show=hand,objects,simulated,tracked,floor"],
  ],
};
// Pictures of the page in this order. `keys` are the keys that lead from the previous picture to this one.
const shots = [
  { name: "viewer", size: wide, keys: ["1", "2", "3", "f"] },
  { name: "viewer_pressure", size: wide, keys: ["k", "o", "c"] },
  { name: "viewer_strain", size: wide, keys: ["n", "o"] },
  { name: "viewer_beside", size: wide, keys: ["n", "c", "b", "3", "f"] },
  { name: "viewer_dark", size: wide, keys: ["b", "1", "t"] },
  { name: "viewer_phone", size: phone, keys: ["2", "3", "f", "p"] },
];
const VR = { name: "viewer_vr", size: { width: 1280, height: 640 } };
const names = process.argv.slice(2);
const wanted = (name) => names.length === 0 || names.includes(name);

for (const [name, words] of Object.entries(rendered))
  if (wanted(name))
    execFileSync(`${build}/bin/softhand`, ["render", scene, ...words, "--out", `${images}/${name}.png`], {
      stdio: "inherit",
    });

// Drawing without a graphics card takes processor time from the simulation whose figures are shown. Therefore the page
// draws rarely and in a small size while the simulation runs. After `standStill` the page's time stops, and the page
// ignores further data.
function holdTime() {
  const [draw, now] = [window.requestAnimationFrame.bind(window), performance.now.bind(performance)];
  let [stood, heard] = [null, 0];
  window.standStill = () => (stood = heard);
  performance.now = () => stood ?? now();
  window.requestAnimationFrame = (run) =>
    setTimeout(() => draw((time) => run(stood ?? time)), stood === null ? 4000 : 0);
  const { set } = Object.getOwnPropertyDescriptor(WebSocket.prototype, "onmessage");
  Object.defineProperty(WebSocket.prototype, "onmessage", {
    set(take) {
      set.call(this, (event) => {
        if (stood !== null) return;
        heard = now();
        take(event);
      });
    },
  });
  Object.defineProperty(WebSocket.prototype, "onclose", { set() {} });
}
/** Emulates a headset whose wearer looks down at the table. */
function wearHeadset() {
  const device = (window.emulated = new window.IWER.XRDevice(window.IWER.metaQuest3, { stereoEnabled: true }));
  device.installRuntime({ forceInstall: true });
  const { prototype } = XRReferenceSpace;
  const byMatrix = prototype.getOffsetReferenceSpace; // as in xr_test.mjs
  prototype.getOffsetReferenceSpace = function (offset) {
    return byMatrix.call(this, offset.matrix);
  };
  device.fovy = 1; // makes the centre of the view large
  device.position.set(0, 1.5, 0);
  device.quaternion.set(-0.34, 0, 0, 0.94);
}
/** Shows the moment at two thirds of the longest time in which the thumb presses. Throws if the thumb never presses. */
function showHeld() {
  const [scrub, force] = ["#scrub", "[data-finger=thumb]"].map((part) => document.querySelector(part));
  const show = (at) => {
    scrub.value = String(at);
    scrub.dispatchEvent(new Event("input"));
    return Number(force.textContent) > 1;
  };
  let [best, begin] = [[0, 0], -1];
  for (let at = 0; at <= 1000; at += 10) {
    const presses = show(at);
    if (presses && begin < 0) begin = at;
    if ((!presses || at === 1000) && begin >= 0) {
      if (at - begin > best[1] - best[0]) best = [begin, at];
      begin = -1;
    }
  }
  if (best[1] === 0) throw new Error("the cube was never held");
  show(Math.round(best[0] + (2 * (best[1] - best[0])) / 3));
}

/**
 * A page with a run of the demo, at the moment that the pictures show. `close` ends its browser. Only one page may
 * exist at a time, because a page behind another page does not draw.
 */
async function watched(size, prepare) {
  const rig = new Process(`${build}/bin/softhand`, "up", `${source}/config/rigs/demo.toml`, "--set", "viewer.port=0");
  const [, url] = await rig.line(/see it at (\S+)/, 60);
  const chromium = await browser();
  const page = await chromium.newPage({ viewport: size });
  page.setDefaultTimeout(300000);
  await page.addInitScript(holdTime);
  await prepare(page);
  // The gateway sends only shown data, so the page first shows everything that any picture shows.
  const everything = "hand,objects,tracked,intermediate,simulated,contacts,coupling,floor";
  await page.goto(`${url}?quality=high&theme=light&show=${everything}`);
  const small = await page.addStyleTag({ content: "#stage { width: 64px; height: 40px; }" });
  const kept = () => Number.parseFloat(document.getElementById("scrub").title);
  await until("enough of the demo", async () => (await page.evaluate(kept)) >= SECONDS, 300);
  await page.keyboard.press("Space");
  await page.evaluate(() => window.standStill());
  await rig.end("SIGINT");
  await small.evaluate((element) => element.remove());
  await page.evaluate(showHeld);
  return { page, close: () => chromium.close() };
}
async function shoot(page, name) {
  const end = (await page.evaluate(() => window.softhand.counts.drawn)) + 3;
  await until("pictures", () => page.evaluate((n) => window.softhand.counts.drawn >= n, end), 300);
  await page.screenshot({ path: `${images}/${name}.png` });
  console.log(`${name}.png`);
}

if (shots.some(({ name }) => wanted(name))) {
  const { page, close } = await watched(wide, async () => {});
  for (const { name, size, keys } of shots) {
    await page.setViewportSize(size);
    for (const key of keys) await page.keyboard.press(key);
    if (wanted(name)) await shoot(page, name);
  }
  await close();
}
if (wanted(VR.name)) {
  const { page, close } = await watched(VR.size, async (one) => {
    await one.addInitScript({ path: `${build}/services/viewer/page/work/node_modules/iwer/build/iwer.min.js` });
    await one.addInitScript(wearHeadset);
  });
  for (const key of ["1", "2", "3", "f"]) await page.keyboard.press(key);
  await page.click("#enter-vr");
  await until("the session", () => page.evaluate(() => document.documentElement.dataset.session), 300);
  await shoot(page, VR.name);
  await close();
}
process.exit(0);
