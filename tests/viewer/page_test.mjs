// Tests of the page in a browser, with data from a gateway over real DDS.
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { networkInterfaces } from "node:os";
import { after, before, test } from "node:test";
import { Process, browser, build, frame, gateway, pause, publisher, source as folder, until } from "./harness.mjs";

// Chromium draws in software here. With all pixels it drew 3.75 pictures a second on a slow machine.
const size = { viewport: { width: 800, height: 500 }, deviceScaleFactor: 0.5 };
let chromium, source, viewer, page;
const errors = [];

before(async () => {
  source = publisher();
  viewer = await gateway();
  chromium = await browser();
  page = await chromium.newPage(size);
  page.on("pageerror", (error) => errors.push(String(error)));
  await page.goto(viewer.url);
  // Pictures are compared. So the page must not change its resolution between them when drawing becomes slow or fast.
  await page.evaluate(() => window.softhand.fixResolution(0.5));
});
after(async () => {
  await chromium?.close();
  await Promise.all([...Process.all].map((process) => process.end("SIGKILL")));
});

/** Share of pixels that differ between two results of `pixels`. */
function difference(a, b) {
  let differing = 0;
  for (let i = 0; i < a.length; i += 3)
    if (Math.abs(a[i] - b[i]) + Math.abs(a[i + 1] - b[i + 1]) + Math.abs(a[i + 2] - b[i + 2]) > 24) ++differing;
  return differing / (a.length / 3);
}
/**
 * The canvas without the page's controls, RGB. If the browser's graphics process has ended, it waits for the next one.
 * After that, Chromium 156 draws such a canvas into a 2D canvas as black, so the pixels are read from the context.
 */
const pixels = () =>
  until("graphics", () =>
    page.evaluate(
      () =>
        new Promise((done) =>
          requestAnimationFrame(() => {
            const gl = document.getElementById("stage").getContext("webgl2");
            const { drawingBufferWidth: width, drawingBufferHeight: height } = gl;
            const rgba = new Uint8Array(4 * width * height);
            gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
            done(gl.isContextLost() ? null : [...rgba].filter((_, i) => i % 4 !== 3));
          }),
        ),
    ),
  );
/** Waits until the page has drawn all earlier changes. */
async function drawn(pictures = 2) {
  const end = (await page.evaluate(() => window.softhand.counts.drawn)) + pictures;
  await until("pictures", () => page.evaluate((n) => window.softhand.counts.drawn >= n, end), 60);
}
/** Waits until a paused picture stands still, because skin and camera may still move. Returns its pixels. */
async function still() {
  let last = await pixels();
  await until("a picture that stands still", async () => {
    await pause(300);
    await drawn();
    const now = await pixels();
    const same = difference(last, now) < 0.0002;
    last = now;
    return same;
  }, 60);
  return last;
}
/**
 * True if steps back change a paused picture. The hand sways. So 12 samples earlier it may have been at its turning
 * point, a few millimetres away, and another 12 samples earlier at the same place. Then it was elsewhere before.
 */
async function stepsBackChange(paused) {
  for (let i = 0; i < 3; ++i) {
    for (let j = 0; j < 12; ++j) await page.keyboard.down(",");
    await page.keyboard.up(",");
    await drawn();
    if (difference(paused, await pixels()) > 0.001) return true;
  }
  return false;
}
/** Runs `check` with a picture that shows only objects and the floor. */
async function onlyObjects(check) {
  const others = ["#show-hand", "#show-contacts", "#show-coupling", "#show-simulated"];
  const on = [];
  for (const id of others) if (await pressed(id)) on.push(id);
  for (const id of on) await page.click(id);
  await drawn();
  try {
    await check();
  } finally {
    for (const id of on) await page.click(id);
  }
}
/** Sends a message by the form of the page's panel. */
async function tell(module, key, value) {
  await page.selectOption("#message select", module);
  await page.fill("#message [name=key]", key);
  await page.fill("#message [name=value]", value);
  await page.click("#message button");
  await page.focus("#stage");
}
const state = () => page.locator("#connection").getAttribute("data-state");
const pressed = async (id) => (await page.locator(id).getAttribute("aria-pressed")) === "true";

test("the page connects and draws the hand", async () => {
  await until("connected", async () => (await state()) === "open");
  await until("nodes", () => page.evaluate(() => window.softhand.counts.nodes > 20), 90);
  await page.keyboard.press("Space");
  const withHand = await still();
  await page.click("#show-hand");
  await drawn();
  const without = await pixels();
  // Beside the open panel the hand covers 0.9 to 1.5 % of the picture, depending on where it sways.
  assert.ok(difference(withHand, without) > 0.004, `the hand covers ${difference(withHand, without)} of the picture`);
  await page.click("#show-hand");
  await drawn();
  assert.ok(difference(withHand, await pixels()) < 0.002, "the hand must be visible again");
  await page.click("#live");
});

test("the hand moves", async () => {
  const first = await pixels();
  await until("a different picture", async () => difference(first, await pixels()) > 0.005);
});

test("each toggle changes what is drawn, by mouse and by key", async () => {
  await page.click("#show-coupling");
  await page.click("#show-simulated");
  await until("skeleton and wrenches", () => page.evaluate(() => window.softhand.counts.nodes > 60), 60);
  await pause(1000);
  await page.click("#pause");
  await drawn();
  for (const [id, key] of [
    ["#show-simulated", "3"],
    ["#show-contacts", "c"],
    ["#show-coupling", "f"],
    ["#show-objects", "o"],
    ["#show-floor", "g"],
    ["#colour-pressure", "k"],
  ]) {
    const before = await pixels();
    const was = await pressed(id);
    await page.keyboard.press(key);
    await drawn();
    assert.notEqual(await pressed(id), was, id);
    const changed = difference(before, await pixels());
    assert.ok(changed > 0.0004, `${id} changed ${changed}`);
    await page.click(id);
    await drawn();
  }
  await page.click("#live");
});

test("keys turn and zoom the view, and move the slider if the slider has the focus", async () => {
  await page.click("#pause");
  await page.focus("#stage");
  for (const key of ["ArrowLeft", "ArrowUp", "+"]) {
    await drawn();
    const before = await pixels();
    for (let i = 0; i < 4; ++i) await page.keyboard.press(key);
    await drawn();
    assert.ok(difference(before, await pixels()) > 0.01, key);
  }
  const part = async () => Number(await page.locator("#scrub").inputValue());
  const before = await part();
  await page.focus("#scrub");
  await page.keyboard.press("ArrowLeft");
  assert.ok((await part()) < before);
  await page.keyboard.press("v");
  await page.click("#live");
});

test("the panel shows the figures of the published status", async () => {
  const row = page.locator('#modules tr[data-module="hand"]');
  await row.waitFor();
  const cell = (field) => row.locator(`[data-field="${field}"]`).textContent();
  assert.equal(await cell("rate"), "90/90");
  assert.equal(await cell("p50"), "2.75");
  assert.equal(await cell("p99"), "8.25");
  assert.equal(await cell("age"), "12.5");
  // The publisher's misses equal the status's sequence number, so both values of the row must come from one status.
  const [misses, sequence] = await row.evaluate((tr) => [
    tr.querySelector('[data-field="misses"]').textContent,
    tr.dataset.sequence,
  ]);
  assert.equal(misses, sequence);
  assert.equal(await cell("p999"), "9.75");
  assert.equal(await cell("drops"), "4");
  const physics = (module, field) =>
    page.locator(`#physics [data-module="${module}"] [data-field="${field}"]`).textContent();
  for (const [module, figures] of Object.entries({
    hand: {
      residual: "0.0125 N",
      iterations: "3",
      contacts: "1",
      penetration: "0.400 mm",
      inverted: "2",
      "coupling stretch": "1.75 mm",
      "chord steps": "17",
      tissue: "12.0 mJ",
      contact: "3.00 mJ",
      "ledger work": "1.25 J",
      "ledger residual": "2e-9 J",
    },
    haptic: {
      passivity: "-250 mJ",
      "second writer": "42",
      "second writer of": "bone_wrench: tracking, process 4711 on lab-pc",
    },
  }))
    for (const [field, text] of Object.entries(figures))
      assert.equal(await physics(module, field), text, `${module}: ${field}`);
  const drops = (module) => page.locator(`#modules tr[data-module="${module}"] [data-field="drops"]`);
  assert.equal(await drops("haptic").getAttribute("class"), "bad");
  assert.match(await drops("haptic").getAttribute("title"), /second writer of bone_wrench: tracking, process 4711/);
  assert.equal((await drops("hand").getAttribute("class")) ?? "", "");
  assert.equal(await page.locator("#forces [data-finger=index]").textContent(), "1.50");
  assert.equal(await page.locator('#modules tr[data-module="haptic"] [data-field="age"]').textContent(), "1235 s");
  // No part of the panel is cut off, and each figure is on one line.
  const wide = () =>
    [...document.querySelectorAll("#panel, #panel .scroll")].filter((part) => part.scrollWidth > part.clientWidth)
      .length;
  assert.equal(await page.evaluate(wide), 0);
  const lines = () =>
    new Set([...document.querySelectorAll('#physics [data-module="hand"] dd')].map((figure) => figure.offsetHeight))
      .size;
  assert.equal(await page.evaluate(lines), 1);
});

test("a message is sent and its reply is shown", async () => {
  await page.click("#reset");
  await source.line(/message \* reset now/);
  await until("the answer", async () => /hand: done as asked/.test(await page.locator("#replies").textContent()));
});

// An address other than localhost. A connection to it comes from it.
const lan = Object.values(networkInterfaces())
  .flat()
  .find(({ family, internal }) => family === "IPv4" && !internal)?.address;
const skip = !lan && "no address";
const prompt = () =>
  page.evaluate(() => {
    const [box, text, seconds] = ["prompt", "prompt-text", "prompt-seconds"].map((id) => document.getElementById(id));
    return box.hidden ? null : { text: text.textContent, seconds: Number(seconds.textContent) };
  });

test("the prompts of a calibration are shown with a countdown", async () => {
  assert.equal(await prompt(), null);
  // A hand that pinches does not show the postures.
  const tracker = new Process(`${build}/bin/softhand-tracker-replay`, "--config", `${folder}/config/scenes/pinch.toml`);
  const calibration = new Process(`${build}/bin/softhand`, "calibrate", "--seconds", "16");
  const first = await until("the first prompt", async () => {
    const shown = await prompt();
    return shown !== null && shown.text === "1/4 Stretch your hand flat and spread the fingers" && shown;
  });
  assert.ok(first.seconds > 1 && first.seconds <= 4, `${first.seconds} s`);
  await until("the countdown", async () => (await prompt())?.seconds < first.seconds);
  const size = () => parseFloat(getComputedStyle(document.getElementById("prompt")).fontSize);
  assert.ok((await page.evaluate(size)) >= 28, "large letters");
  await until("the end", async () => (await prompt())?.text === "Refused: the terminal says why", 30);
  assert.equal(await calibration.ended, 1);
  assert.match(calibration.output, /the right hand is refused: step [12] of 4/);
  await tracker.end();
  await until("no prompt", async () => (await prompt()) === null);
});

test("a prompt can be taken back, and a bad one is refused", async () => {
  await tell("viewer", "prompt", "600 Wait");
  await until("the prompt", async () => (await prompt())?.text === "Wait");
  for (const bad of ["Wait", "-1 Wait", "601 Wait", "nan Wait", "5"]) await tell("viewer", "prompt", bad);
  await until("the answers", async () => {
    const replies = await page.locator("#replies").textContent();
    return replies.split("viewer: refused, prompt: expected seconds").length === 6;
  });
  await tell("viewer", "prompt", "600 ");
  await until("no prompt", async () => (await prompt()) === null);
});

const badge = () => page.locator("#pace-badge").textContent();
test("the page halts, steps and slows down the simulation, and shows the pace", async () => {
  assert.ok(await page.locator("#pace-badge").isHidden());
  await page.click("#halt");
  await source.line(/message \* pace 0\n/);
  await until("halted", async () => (await badge()) === "simulation halted" && (await pressed("#halt")));
  await page.keyboard.press("z");
  await source.line(/message \* advance 0\.0111111111\n/);
  await page.keyboard.press("x");
  await source.line(/message \* pace 1\n/);
  await until("real time", () => page.locator("#pace-badge").isHidden());
  await page.keyboard.press("m");
  await source.line(/message \* pace 0\.5\n/);
  await until("half", async () => (await badge()) === "simulation at ½");
  await page.selectOption("#pace", "0.1");
  await source.line(/message \* pace 0\.1\n/);
  await page.selectOption("#pace", "1");
  await until("real time", () => page.locator("#pace-badge").isHidden());
});

test("a held key halts the simulation once, and steps the picture repeatedly", async () => {
  const said = () => source.output.split("message * pace").length;
  const before = said();
  await page.keyboard.down("x");
  await until("halted", async () => (await badge()) === "simulation halted");
  for (let i = 0; i < 5; ++i) await page.keyboard.down("x"); // like the repetition of a keyboard
  await page.keyboard.up("x");
  await pause(500);
  assert.equal(said() - before, 1);
  assert.ok(await pressed("#halt"));
  await page.keyboard.press("x");
  await until("real time", () => page.locator("#pace-badge").isHidden());
  await page.click("#pause");
  await drawn();
  const first = await pixels();
  assert.ok(await stepsBackChange(first));
  await page.click("#live");
});

test("the slower key selects the next slower pace from any pace", async () => {
  await tell("*", "pace", "0.3");
  await until("0.3", async () => (await badge()) === "simulation at 0.30");
  await page.keyboard.press("m");
  await source.line(/message \* pace 0\.25\n/);
  await tell("*", "pace", "1");
  await until("real time", () => page.locator("#pace-badge").isHidden());
});

test("a page with a closed panel shows that the simulation is halted", async () => {
  await page.click("#panel-button");
  await page.keyboard.press("x");
  await until(
    "halted",
    async () => (await page.locator("#pace-badge").isVisible()) && (await badge()) === "simulation halted",
  );
  await page.keyboard.press("x");
  await until("real time", () => page.locator("#pace-badge").isHidden());
  await page.click("#panel-button");
});

test("the page selects another offered scene and switches motors off", async () => {
  await page.locator("#offer-scene").waitFor({ state: "visible" });
  assert.deepEqual(await page.locator("#offer-scene option").allTextContents(), ["demo", "pinch lift"]);
  await until("the running scene", async () => (await page.locator("#offer-scene").inputValue()) === "demo");
  await page.selectOption("#offer-scene", "pinch_lift");
  await source.line(/message rig scene pinch_lift\n/);
  await pause(500);
  assert.equal(await page.locator("#offer-scene").inputValue(), "pinch_lift");
  assert.ok(await pressed("#motors-haptic"));
  await page.click("#motors-haptic");
  await source.line(/message haptic motors off\n/);
  await until("off", async () => !(await pressed("#motors-haptic")));
  assert.equal(await page.locator('#modules tr[data-module="rig"]').count(), 0);
});

test("the page shows the scenes that the rig offers now, with blanks in their names", async () => {
  await tell("*", "offer", "my own");
  const options = page.locator("#offer-scene option");
  await until("the offer", async () => (await options.allTextContents()).join() === "demo,my own");
  await page.selectOption("#offer-scene", "my own");
  await source.line(/message rig scene my own\n/);
  await until("the running scene", async () => (await page.locator("#offer-scene").inputValue()) === "my own");
});

test("an object that the world no longer lists disappears", () =>
  onlyObjects(async () => {
    const both = await pixels();
    await tell("*", "cube", "gone");
    await until("the cube is gone", async () => difference(both, await pixels()) > 0.001);
    await tell("*", "cube", "listed");
    await until("it is back", async () => difference(both, await pixels()) < 0.0002);
  }));

test("objects of two worlds with the same id are both drawn", () =>
  onlyObjects(async () => {
    const cube = await pixels();
    await tell("*", "second_world", "there");
    await until("the other world's cube", async () => difference(cube, await pixels()) > 0.001);
    const both = await pixels();
    await tell("*", "cube", "gone");
    await until("it stays alone", async () => difference(both, await pixels()) > 0.001);
    const second = await pixels();
    assert.ok(difference(cube, second) > 0.001);
    await tell("*", "second_world", "removed");
    await until("neither", async () => difference(second, await pixels()) > 0.001);
    await tell("*", "cube", "listed");
    await until("the cube is back", async () => difference(cube, await pixels()) < 0.0002);
  }));

test("a flexible object appears, changes its shape, shows its strain and disappears", () =>
  onlyObjects(async () => {
    const without = await pixels();
    await tell("*", "ball", "round");
    // Beside the open panel the ball covers 0.4 % of the picture.
    await until("the ball", async () => difference(without, await pixels()) > 0.002);
    await drawn();
    const round = await pixels();
    await tell("*", "ball", "flat");
    await until("another shape", async () => difference(round, await pixels()) > 0.0005);
    await drawn();
    const flat = await pixels();
    await page.click("#colour-strain");
    await until("its strain", async () => difference(flat, await pixels()) > 0.001);
    await page.click("#colour-strain");
    await until("its own colour", async () => difference(flat, await pixels()) < 0.0002);
    await page.click("#show-objects");
    await until("no objects", async () => difference(flat, await pixels()) > 0.002);
    await page.click("#show-objects");
    await tell("*", "ball", "removed");
    await until("it is gone", async () => difference(without, await pixels()) < 0.0002);
  }));

test("pause freezes the picture, steps move it, and live continues", async () => {
  await page.click("#pause");
  await drawn();
  const frozen = await pixels();
  await pause(500);
  await drawn();
  assert.equal(difference(frozen, await pixels()), 0);
  assert.ok(await stepsBackChange(frozen));
  await page.keyboard.press("l");
  await drawn();
  assert.ok(await page.locator("#live").isDisabled());
});

test("the same picture returns after the browser's graphics process has ended", async () => {
  const main = page;
  page = await chromium.newPage(size);
  try {
    await page.goto(`${viewer.url}?quality=high`); // it has one more texture to restore
    await page.evaluate(() => window.softhand.fixResolution(0.5));
    await until("nodes", () => page.evaluate(() => window.softhand.counts.nodes > 0), 90);
    await page.keyboard.press("Space");
    const before = await still();
    const session = await chromium.newBrowserCDPSession();
    session.send("Browser.crashGpuProcess").catch(() => {}); // never answered
    await page.locator("#blind").waitFor({ state: "visible" });
    await page.locator("#blind").waitFor({ state: "hidden" });
    await drawn();
    assert.ok(difference(before, await pixels()) < 0.0002);
  } finally {
    await page.close();
    page = main;
  }
});

test("a run is saved and played twice, and keys still work", async () => {
  await page.focus("#save");
  const [download] = await Promise.all([page.waitForEvent("download"), page.keyboard.press("Enter")]);
  const file = await download.path();
  await page.focus("#open"); // the button keeps the focus afterwards
  await page.setInputFiles("#open", file);
  const plays = async () => !(await page.locator("#live").isDisabled());
  await until("it plays", plays);
  await page.keyboard.press("l");
  await until("live mode", async () => !(await plays()));
  await page.setInputFiles("#open", {
    name: "notes.shv",
    mimeType: "application/octet-stream",
    buffer: Buffer.from("no recording at all, but long enough for a head"),
  });
  const refused = page.locator("#refused");
  await refused.waitFor({ state: "visible" });
  assert.match(await refused.textContent(), /notes\.shv was not opened: no recording/);
  const old = await readFile(file);
  old.writeUInt16LE(2, 8 + 12 + 4); // the version in the header of the first frame
  await page.setInputFiles("#open", { name: "old.shv", mimeType: "application/octet-stream", buffer: old });
  await until("an old file is refused", async () =>
    (await refused.textContent()).includes("old.shv was not opened: frame version 2, expected 3"),
  );
  await page.setInputFiles("#open", file);
  await until("the same plays again", plays);
  assert.ok(await refused.isHidden());
  await page.click("#live");
});

test("a plot shows each sample of a file once, even after repeated playing", async () => {
  const contacts = (time) => {
    const payload = Buffer.alloc(344);
    payload.writeDoubleLE(time, 0);
    return frame(6, payload);
  };
  const parts = [Buffer.from("SHVR\x01\0\0\0", "latin1")];
  for (let i = 0; i < 10; ++i) {
    const [head, content] = [Buffer.alloc(12), contacts(1000 + 0.05 * i)];
    head.writeDoubleLE(50 * i, 0);
    head.writeUInt32LE(content.length, 8);
    parts.push(head, content);
  }
  await page.setInputFiles("#open", {
    name: "short.shv",
    mimeType: "application/octet-stream",
    buffer: Buffer.concat(parts),
  });
  await pause(4000);
  // Number of points of the longest line that is drawn during a second.
  const longest = await page.evaluate(
    () =>
      new Promise((done) => {
        const { prototype } = CanvasRenderingContext2D;
        const { beginPath, lineTo } = prototype;
        let [points, most] = [0, 0];
        prototype.beginPath = function () {
          points = 0;
          beginPath.call(this);
        };
        prototype.lineTo = function (x, y) {
          most = Math.max(most, ++points);
          lineTo.call(this, x, y);
        };
        setTimeout(() => {
          Object.assign(prototype, { beginPath, lineTo });
          done(most);
        }, 1000);
      }),
  );
  assert.ok(longest > 1 && longest <= 10, `${longest} points`);
  await page.click("#live");
});

test("the theme follows the system until the user selects one", async () => {
  const theme = () => page.evaluate(() => document.documentElement.dataset.theme);
  for (const colorScheme of ["dark", "light"]) {
    await page.emulateMedia({ colorScheme });
    await until(colorScheme, async () => (await theme()) === colorScheme, 5);
  }
  await page.keyboard.press("t");
  await page.emulateMedia({ colorScheme: "dark" });
  await page.emulateMedia({ colorScheme: "light" });
  assert.equal(await theme(), "dark");
  await page.keyboard.press("t");
});

test("a killed gateway is reported and recovered from", async () => {
  await viewer.process.end("SIGKILL");
  await until("the lost connection is shown", async () => (await state()) === "lost");
  assert.match(await page.locator("#connection").textContent(), /lost/);
  viewer = await gateway(viewer.port);
  await until("connected again", async () => (await state()) === "open");
  const nodes = await page.evaluate(() => window.softhand.counts.nodes);
  await until("nodes again", () => page.evaluate((n) => window.softhand.counts.nodes > n + 20, nodes), 60);
});

test("data that a new gateway does not send disappears", async () => {
  const shown = ["#show-hand", "#show-objects", "#show-contacts", "#show-coupling", "#show-simulated"];
  for (const id of shown) if (await pressed(id)) await page.click(id);
  await drawn();
  const empty = await pixels();
  for (const id of shown) await page.click(id);
  await pause(1000);
  await drawn();
  assert.ok(difference(empty, await pixels()) > 0.004);
  await source.end();
  await viewer.process.end("SIGKILL");
  await until("the lost connection is shown", async () => (await state()) === "lost");
  viewer = await gateway(viewer.port);
  await until("connected again", async () => (await state()) === "open");
  await pause(1500); // the gateway's state comes twice per second
  await drawn();
  assert.equal(difference(empty, await pixels()), 0);
  source = publisher();
  await until("the new data", async () => difference(empty, await pixels()) > 0.004);
  for (const id of shown.slice(3)) await page.click(id);
});

test("a gateway that hangs is reported and recovered from", async () => {
  viewer.process.child.kill("SIGSTOP");
  await until("the lost connection is shown", async () => (await state()) === "lost", 10);
  viewer.process.child.kill("SIGCONT");
  await until("connected again", async () => (await state()) === "open");
});

test("on a phone no part of the page overlaps another or leaves the screen", async () => {
  await page.setViewportSize({ width: 390, height: 844 });
  await page.click("#colour-strain");
  await page.keyboard.press("x");
  await page.locator("#pace-badge").waitFor({ state: "visible" });
  for (const panel of [true, false]) {
    if ((await pressed("#panel-button")) !== panel) await page.click("#panel-button");
    const faults = await page.evaluate((withPanel) => {
      const box = (selector) => document.querySelector(selector).getBoundingClientRect();
      const found = [];
      const parts = ["header", "#toggles", "#legend", ...(withPanel ? ["#panel"] : []), "#time"];
      parts.forEach((part, i) => {
        const { left, right, bottom } = box(part);
        const next = parts[i + 1];
        if (left < 0 || right > innerWidth || bottom > (next ? box(next).top : innerHeight)) found.push(part);
      });
      for (const each of ["#connection", "#pace-badge", "#theme-button", "#panel-button"]) {
        const { left, right, width } = box(each);
        if (width < 24 || left < box("header").left || right > box("header").right) found.push(each);
      }
      for (const each of ["#pause", "#back", "#forward", "#slow", "#scrub", "#live", "#save", "label.button"]) {
        const { left, right, top, bottom, width, height } = box(each);
        const bar = box("#time");
        if (width < 24 || height < 16 || left < bar.left || right > bar.right || top < bar.top || bottom > bar.bottom)
          found.push(each);
      }
      return found;
    }, panel);
    assert.deepEqual(faults, []);
  }
  await page.keyboard.press("x");
  await page.click("#colour-strain");
});

test("the page threw no error and got no bad frame during these tests", async () => {
  assert.deepEqual(errors, []);
  assert.equal(await page.evaluate(() => window.softhand.counts.bad), 0);
  await page.close(); // the next pages need the processor that draws this one
});

// ---- a page whose frames come from the test ----

const SHOW = 32;
const u32 = (...values) => Buffer.from(new Uint32Array(values).buffer);
const f32 = (...values) => Buffer.from(new Float32Array(values).buffer);
const f64 = (...values) => Buffer.from(new Float64Array(values).buffer);
const text = (value, size) => Buffer.concat([Buffer.from(value), Buffer.alloc(size)]).subarray(0, size);
const named = (values, put) =>
  Buffer.concat([
    u32(Object.keys(values).length, 0),
    ...Object.entries(values).flatMap(([name, value]) => [text(name, 32), put(value)]),
  ]);
let sequence = 0;
const stamp = () => f64(++sequence / 60, sequence / 60, sequence);
const contacts = (thumb) => Buffer.concat([stamp(), f32(thumb), Buffer.alloc(316)]);
const status = (module, pace, motors = {}) => {
  const names = [
    "rate_hz nominal_rate_hz step_ms_p50 step_ms_p99 step_ms_p999 deadline_misses input_drops input_age_ms iterations",
    "residual contact_count penetration inverted_elements steps coupling_stretch passivity_energy",
  ];
  const fields = Object.fromEntries(names.join(" ").split(" ").map((name) => [name, 1]));
  const lists = { energies: {}, ledger: {}, counters: { pace, ...motors } };
  return Buffer.concat([
    stamp(),
    text(module, 64),
    named(fields, f64),
    named({ second_writer: "" }, () => Buffer.alloc(128)),
    named(lists, (list) => named(list, f64)),
  ]);
};
const object = (shape, vertices = []) =>
  Buffer.concat([u32(0, 0, shape, vertices.length / 3), f32(1, 1, 0.03, 0.03, 0.03), text("", 64), f32(...vertices)]);
const objects = (...ids) =>
  Buffer.concat([
    stamp(),
    u32(ids.length, 0),
    ...ids.flatMap((id) => [u32(id, 0, 0), f32(0.1 * id - 0.15, 0.05, 0, 0, 0, 0, 1, 0, 0, 0)]),
  ]);
const HULL = [0, 0, 0, 0.05, 0, 0, 0, 0.05, 0, 0, 0, 0.05];

/** `send(type, payload, instance)` sends a frame to the page, and `heard` has what the page sent. */
let played = null;
async function player() {
  if (played) return played;
  const made = { page: await chromium.newPage(size), heard: [], epoch: 1n };
  made.page.on("pageerror", (error) => errors.push(String(error)));
  await made.page.routeWebSocket(/stream/, (socket) => {
    socket.onMessage((message) => made.heard.push(message));
    made.send = (type, payload, instance = 0) => socket.send(frame(type, payload, { instance }));
  });
  // The camera stands still.
  await made.page.goto(`${viewer.url}?show=hand,objects,tracked,contacts&camera=0.2,0.3,0.5,0,0.05,0`);
  await made.page.evaluate(() => window.softhand.fixResolution(0.5));
  await until("connected", () => made.send);
  const state = () => {
    const epoch = Buffer.alloc(8);
    epoch.writeBigUInt64LE(made.epoch);
    made.send(12, Buffer.concat([f64(0), epoch, u32(1, 60), f64(sequence, ...Array(12).fill(0))]));
  };
  // At once: a page that never got the first epoch does not notice that the next one is another.
  state();
  setInterval(state, 200).unref();
  made.hands = () => made.page.evaluate(() => window.softhand.handCount());
  made.programs = () => made.page.evaluate(() => window.softhand.programCount());
  made.count = (parts) => made.page.locator(parts).count();
  return (played = made);
}
/** Runs `check(player)`, whose pictures are those of its page. */
async function withPlayer(check) {
  const main = page;
  const made = await player();
  page = made.page;
  try {
    await check(made);
  } finally {
    page = main;
  }
}

test("each of two hands has its own figures", () =>
  withPlayer(async ({ send }) => {
    send(6, contacts(1), 0);
    const names = () => page.locator("#forces h4:visible").allTextContents();
    const thumb = (hand) => page.locator(`#forces [data-hand="${hand}"] [data-finger=thumb]`).textContent();
    await until("the left hand", async () => (await page.locator("#forces .hand").count()) === 1);
    assert.deepEqual(await names(), []);
    send(6, contacts(2), 1);
    await until("both", async () => (await names()).join() === "left hand,right hand");
    assert.deepEqual([await thumb(0), await thumb(1)], ["1.00", "2.00"]);
    assert.equal(await page.locator("#penetrations canvas").count(), 2);
  }));

test("another gateway is noticed although it has sent more bytes", () =>
  withPlayer(async (made) => {
    await until("hands", async () => (await made.hands()) === 2);
    ++made.epoch;
    await until("no hands", async () => (await made.hands()) === 0);
    assert.equal(await made.count("#forces .hand"), 0);
  }));

test("a replaced object leaves no material", () =>
  withPlayer(async ({ send, programs }) => {
    for (const id of [1, 2]) send(8, object(1), id);
    send(7, objects(1, 2));
    await drawn();
    const before = await programs();
    send(8, object(5, HULL), 2);
    await until("flat shading", async () => (await programs()) > before);
    send(8, object(1), 2);
    await until("as before", async () => (await programs()) === before);
  }));

test("what a dead stream showed disappears, but not while simulation or page stand still", () =>
  withPlayer(async (made) => {
    const figures = () => made.count("#forces .hand:not(.silent)");
    // A new gateway clears the picture. The figures show when it has.
    made.send(6, contacts(1), 1);
    await until("figures", async () => (await made.count("#forces .hand")) === 1);
    ++made.epoch;
    await until("an empty picture", async () => (await made.count("#forces .hand")) === 0);
    await drawn();
    const empty = await pixels();
    const skin = Buffer.concat([
      u32(3, 3, 1, 0),
      f32(...[0, 1, 2].flatMap(() => [1, 0, 0, 0])),
      Buffer.from(new Uint16Array([0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 0, 1, 2, 0]).buffer),
    ]);
    const nodes = (x) =>
      Buffer.concat([stamp(), f32(x, 0.05, 0), u32(3, 0), f32(1, 0, 0, 0, 0.1, 0, 0, 0, 0.1, 0)]);
    const joints = Array.from({ length: 26 }, (_, j) => [f32(0.004 * j, 0.1, 0.1, 0, 0, 0, 1, 0.01), u32(3)]).flat();
    made.send(1, skin, 1);
    made.send(14, skin, 0);
    made.send(8, object(1), 1);
    let [alive, pace] = [true, 1];
    const timer = setInterval(() => {
      made.send(10, status("hand", pace));
      if (!alive) return;
      made.send(2, nodes(-0.15), 1);
      made.send(3, Buffer.concat([stamp(), u32(0, 0), ...joints]), 1);
      made.send(6, contacts(1), 1);
      made.send(7, objects(1));
      made.send(15, nodes(0.1), 0);
    }, 50);
    const shown = async () => difference(empty, await pixels()) > 0.005 && (await figures()) === 1;
    const stays = async () => {
      alive = false;
      await pause(2500);
      await drawn(12); // the page counts at most 250 ms for a picture
      assert.ok(await shown());
      alive = true;
    };
    try {
      await until("all", shown);
      pace = 0;
      await until("halted", async () => (await badge()) === "simulation halted");
      await stays();
      pace = 1;
      await until("real time", () => page.locator("#pace-badge").isHidden());
      await page.click("#pause");
      await stays();
      await page.click("#live");
      alive = false;
      await until("nothing", async () => difference(empty, await pixels()) === 0 && (await figures()) === 0);
      alive = true;
      await until("all again", shown);
    } finally {
      clearInterval(timer);
    }
  }));

test("a refusal is shown while the panel is closed", () =>
  withPlayer(async ({ heard, send }) => {
    await page.click("#panel-button");
    const shows = () => heard.filter((each) => each.readUInt16LE(6) === SHOW);
    await until("replies are requested", () => (shows().at(-1).readUInt32LE(16) & (1 << 11)) !== 0);
    const before = heard.length;
    await page.keyboard.press("r");
    const asked = await until("the message", () => heard[before]);
    const reply = (id) => {
      const payload = Buffer.concat([Buffer.alloc(8), u32(2, 0), text("hand", 64), text("not now", 128)]);
      payload.writeBigUInt64LE(id);
      return payload;
    };
    const id = asked.readBigUInt64LE(16);
    send(11, reply(id + 1n)); // to another page
    await pause(300);
    assert.ok(await page.locator("#refused").isHidden());
    send(11, reply(id));
    await until("the refusal", async () => (await page.locator("#refused").textContent()) === "hand refused: not now");
    await page.click("#panel-button");
  }));

test("invented hands and modules do not grow the page", () =>
  withPlayer(async ({ count, hands, send }) => {
    for (let i = 0; i < 100; ++i) send(6, contacts(1), i);
    for (let i = 0; i < 300; ++i) send(10, status(`module ${i}`, 1, { motors: 1 }), i);
    const last = page.locator('#modules tr[data-module="module 299"]');
    await last.waitFor({ state: "attached" });
    await until("the hands", async () => (await hands()) === 32);
    assert.equal(await count("#forces .hand"), 32);
    assert.equal(await count("#penetrations .hand"), 32);
    for (const parts of ["#modules tbody tr", "#message option:not([value])", "#devices button", "#physics > details"])
      assert.equal(await count(parts), 128, parts);
    assert.deepEqual(errors, []);
    assert.equal(await page.evaluate(() => window.softhand.counts.bad), 0);
    await page.close();
  }));

test("a page on another machine sends messages with the token of its address", { skip }, async () => {
  const open = await gateway(0, "viewer.address=0.0.0.0", `viewer.hosts=${lan}`);
  const [, address] = await open.process.line(/elsewhere at (\S+)/);
  // Other replies may come before.
  const answers = async (url, pattern) => {
    const away = await chromium.newPage(size);
    await away.goto(url);
    await until("connected", async () => (await away.locator("#connection").getAttribute("data-state")) === "open");
    await away.click("#reset");
    const replies = () => away.locator("#replies").textContent();
    await until(`the answer ${pattern}`, async () => pattern.test(await replies()));
    await away.close();
  };
  await answers(address.replace(/\?.*/, ""), /viewer: refused, other machines need the token/);
  await answers(address, /hand: done as asked/);
  await open.process.end();
});

test("a browser without WebGL shows the reason", async () => {
  const blind = await browser("--disable-3d-apis");
  try {
    const plain = await blind.newPage();
    await plain.goto(viewer.url);
    await until("the reason", async () => /WebGL/.test(await plain.locator("#connection").textContent()), 10);
  } finally {
    await blind.close();
  }
});

test("the page shows why a session was refused", async () => {
  const plain = await chromium.newPage(size);
  await plain.addInitScript(() =>
    Object.defineProperty(navigator, "xr", {
      value: {
        isSessionSupported: async () => true,
        requestSession: () => Promise.reject(new DOMException("hands are not allowed", "NotAllowedError")),
      },
    }),
  );
  await plain.goto(viewer.url);
  await plain.click("#enter-vr");
  await plain.locator("#refused").waitFor({ state: "visible", timeout: 10000 });
  assert.match(await plain.locator("#refused").textContent(), /hands are not allowed/);
  await plain.close();
});
