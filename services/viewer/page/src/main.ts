// Connects connection, timeline, stage and panel with the controls of the page. The address has parameters:
//
// ?plain hides everything but the picture.
//
// ?theme=dark|light, ?colour=skin|pressure|strain and ?quality=high|low set how it is drawn.
//
// ?show=hand,objects,... sets the content at the start.
//
// ?camera=x,y,z,x,y,z sets position and target in metres.
//
// ?tracker=8091 is the port of softhand-tracker-webxr on this page's host.
import { Connection } from "./connection";
import { COUPLING_COLOUR, FORCE_COLOUR, SKELETON_COLOURS } from "./glyphs";
import { type Mode, Headset, offers } from "./headset";
import { Panel, element, swatch } from "./panel";
import { PromptSign } from "./prompt";
import * as protocol from "./protocol";
import { type Frame, Type } from "./protocol";
import { bestQuality } from "./quality";
import { Silence } from "./silence";
import { Simulation } from "./simulation";
import { type Colouring, colourMap } from "./skin";
import { type Shown, Stage } from "./stage";
import { Timeline } from "./timeline";
import * as THREE from "three";

const query = new URLSearchParams(location.search);
const root = document.documentElement;

const shown: Shown = {
  hand: true,
  objects: true,
  tracked: false,
  intermediate: false,
  simulated: false,
  contacts: true,
  coupling: false,
  floor: true,
  beside: false,
};
const asked = query.get("show");
if (asked !== null)
  for (const name of Object.keys(shown) as (keyof Shown)[]) shown[name] = asked.split(",").includes(name);
let colouring: Colouring = (["pressure", "strain"] as const).find((each) => each === query.get("colour")) ?? "skin";
const isWide = (): boolean => window.innerWidth > 760; // as in style.css
let panelOpen = !query.has("plain") && isWide();
const systemTheme = matchMedia("(prefers-color-scheme: dark)");
let themeChosen = query.get("theme") !== null;
let dark = themeChosen ? query.get("theme") === "dark" : systemTheme.matches;
if (query.has("plain")) root.dataset.plain = "";

const quality = (["high", "low"] as const).find((each) => each === query.get("quality")) ?? bestQuality();
function openStage(): Stage {
  try {
    return new Stage(element<HTMLCanvasElement>("stage"), shown, quality);
  } catch (error) {
    element("connection").dataset.state = "lost";
    element("connection").textContent = "this browser cannot draw: WebGL 2 is not available";
    throw error;
  }
}
const stage = openStage();
stage.colouring = colouring;
const camera = query.get("camera")?.split(",").map(Number);
if (camera?.length === 6 && camera.every(Number.isFinite))
  stage.lookFrom(camera.slice(0, 3) as [number, number, number], camera.slice(3) as [number, number, number]);
const panel = new Panel();
const prompts = new PromptSign();
stage.add(prompts.sign);
const counts = { frames: 0, bad: 0, nodes: 0, drawn: 0 };

// ---- frames ----

let epoch: bigint | null = null; // of the gateway
let requested: Type[] = []; // types that the gateway sends
const silence = new Silence();
const apply: Record<number, (payload: DataView, instance: number) => void> = {
  [Type.handDescription]: (payload, instance) => stage.describeHand(instance, protocol.skinDescription(payload)),
  [Type.nodes]: (payload, instance) => {
    stage.deform(instance, protocol.nodes(payload));
    ++counts.nodes;
  },
  [Type.tracked]: (payload, instance) => stage.pose(instance, "tracked", protocol.skeleton(payload)),
  [Type.intermediate]: (payload, instance) => stage.pose(instance, "intermediate", protocol.skeleton(payload)),
  [Type.simulated]: (payload, instance) => stage.pose(instance, "simulated", protocol.skeleton(payload)),
  [Type.contacts]: (payload, instance) => {
    const contacts = protocol.contacts(payload);
    stage.touch(instance, contacts);
    panel.forces(instance, contacts);
  },
  [Type.objects]: (payload, instance) => stage.place(instance, protocol.objects(payload).objects),
  [Type.objectDescription]: (payload, instance) => stage.describeObject(instance, protocol.objectDescription(payload)),
  [Type.softDescription]: (payload, instance) =>
    stage.describeSoftObject(instance, protocol.skinDescription(payload)),
  [Type.softNodes]: (payload, instance) => stage.deformSoftObject(instance, protocol.nodes(payload)),
  [Type.wrench]: (payload, instance) => {
    const { valid, bones } = protocol.wrench(payload);
    stage.couple(instance, valid, bones);
  },
  [Type.status]: (payload) => {
    const status = protocol.status(payload);
    panel.status(status, performance.now());
    simulation.status(status);
  },
  [Type.choices]: (payload) => {
    const { module, choices } = protocol.choices(payload);
    if (module === "rig") simulation.offer(choices);
  },
  [Type.reply]: (payload) => {
    const reply = protocol.reply(payload);
    panel.reply(reply);
    // Replies to other pages come too.
    if (reply.result === 2 && !panelOpen && reply.id > firstId && reply.id <= lastId)
      refused(`${reply.module} refused: ${reply.text}`);
  },
  [Type.gateway]: (payload) => {
    const state = protocol.gateway(payload);
    panel.gateway(state);
    // Another gateway perhaps has another scene, hands and objects. Request everything again, so that the descriptions
    // that it has already sent come again.
    if (epoch !== null && state.epoch !== epoch) {
      timeline.forget();
      connection.send(protocol.show([], 0));
      subscribe();
    }
    epoch = state.epoch;
  },
};
function applyFrame(frame: Frame): void {
  checked(() => apply[frame.type]?.(frame.payload, frame.instance));
  silence.hear(frame);
}
/** Plots get every sample, even if the picture is drawn rarely. */
function passFrame(frame: Frame): void {
  if (frame.type === Type.contacts && panelOpen)
    checked(() => panel.plot(frame.instance, protocol.contacts(frame.payload)));
}
function checked(run: () => void): void {
  try {
    run();
  } catch (error) {
    bad(String(error));
  }
}
function bad(why: string): void {
  ++counts.bad;
  console.warn("frame refused:", why);
}

const timeline = new Timeline(applyFrame, passFrame, () => {
  stage.clear();
  panel.clear();
});
// A page from https may open only wss sockets.
const socketScheme = location.protocol === "https:" ? "wss" : "ws";
// The gateway takes messages from other machines only with its token.
const token = query.has("token") ? `?token=${encodeURIComponent(query.get("token") ?? "")}` : "";
const connection = new Connection(`${socketScheme}://${location.host}/stream${token}`, {
  frame: (frame) => {
    ++counts.frames;
    // A prompt is for the person who looks at the page now, whatever time the picture shows.
    if (frame.type === Type.prompt) prompts.show(protocol.prompt(frame.payload), performance.now());
    else timeline.add(performance.now(), frame);
  },
  state: (state, text) => {
    const line = element("connection");
    if (line.dataset.state !== state || line.textContent !== text) {
      line.dataset.state = state;
      line.textContent = text;
    }
    if (state === "open") subscribe();
  },
  bad,
});

/** Tells the gateway which types this page shows. The gateway reads and sends nothing else. */
function subscribe(): void {
  const types: Type[] = [];
  if (!document.hidden) {
    if (shown.hand) types.push(Type.handDescription, Type.nodes);
    if (shown.objects) types.push(Type.objectDescription, Type.objects, Type.softDescription, Type.softNodes);
    if (shown.tracked) types.push(Type.tracked);
    if (shown.intermediate) types.push(Type.intermediate);
    if (shown.simulated) types.push(Type.simulated);
    if (shown.contacts || panelOpen || colouring === "pressure") types.push(Type.contacts);
    if (shown.coupling) types.push(Type.wrench);
    // The head line and the keys of the simulation need the pace and the refusals, whatever is shown.
    types.push(Type.status, Type.choices, Type.prompt, Type.reply);
  }
  requested = types;
  connection.send(protocol.show(types, 0));
}
document.addEventListener("visibilitychange", subscribe);

// ---- controls ----

function press(button: HTMLElement, on: boolean): void {
  button.setAttribute("aria-pressed", String(on));
}

interface Control {
  key: string;
  text: string;
  run: () => void;
}
const controls: Control[] = [];

const switches: [keyof Shown, string, string, number | null][] = [
  ["hand", "Skin", "h", 0xd79a7c],
  ["objects", "Objects", "o", null],
  ["tracked", "Tracked skeleton", "1", SKELETON_COLOURS.tracked],
  ["intermediate", "Intermediate skeleton", "2", SKELETON_COLOURS.intermediate],
  ["simulated", "Simulated skeleton", "3", SKELETON_COLOURS.simulated],
  ["contacts", "Contact forces", "c", FORCE_COLOUR],
  ["coupling", "Coupling forces", "f", COUPLING_COLOUR],
  ["beside", "Skeletons side by side", "b", null],
  ["floor", "Floor", "g", null],
];
for (const [name, text, key, colour] of switches) {
  const button = addToggle(text, key, colour);
  button.id = `show-${name}`;
  press(button, shown[name]);
  button.onclick = () => {
    shown[name] = !shown[name];
    if (name === "beside" && shown.beside) {
      shown.tracked = shown.intermediate = true;
      press(element("show-tracked"), true);
      press(element("show-intermediate"), true);
    }
    press(button, shown[name]);
    stage.show(shown);
    subscribe();
  };
  controls.push({ key, text, run: () => button.click() });
}
for (const [name, text, key] of [
  ["pressure", "Pressure as colour", "k"],
  ["strain", "Strain as colour", "n"],
] as const) {
  const button = addToggle(text, key, null);
  button.id = `colour-${name}`;
  press(button, colouring === name);
  button.onclick = () => setColouring(colouring === name ? "skin" : name);
  controls.push({ key, text, run: () => button.click() });
}
function addToggle(text: string, key: string, colour: number | null): HTMLButtonElement {
  const button = document.createElement("button");
  if (colour !== null) button.append(swatch(`#${colour.toString(16).padStart(6, "0")}`));
  button.append(text, Object.assign(document.createElement("kbd"), { textContent: key.toUpperCase() }));
  element("toggles").append(button);
  return button;
}

function setColouring(to: Colouring): void {
  colouring = stage.colouring = to;
  for (const name of ["pressure", "strain"]) press(element(`colour-${name}`), to === name);
  element("legend").hidden = to === "skin";
  element("legend-title").textContent =
    to === "pressure" ? "Contact pressure" : "Largest principal strain of the skin";
  stage.repaint();
  drawLegend();
  subscribe();
}
function drawLegend(): void {
  if (colouring === "skin") return;
  element("legend-high").textContent =
    colouring === "pressure"
      ? `≥ ${stage.full / 1000} kPa`
      : stage.hasStrain
        ? `≥ ${(100 * stage.full).toFixed(0)} %`
        : "unknown for this hand";
  const canvas = element<HTMLCanvasElement>("legend-bar");
  const context = canvas.getContext("2d")!;
  const colour = new THREE.Color();
  for (let x = 0; x < canvas.width; ++x) {
    context.fillStyle = `#${colourMap(x / (canvas.width - 1), colour).getHexString()}`;
    context.fillRect(x, 0, 1, canvas.height);
  }
}

function setPanel(open: boolean): void {
  panelOpen = open;
  root.dataset.panel = open ? "on" : "off";
  press(element("panel-button"), open);
  layOut();
  subscribe();
}
/** Tells the stage which part of the window is not covered by controls. */
function layOut(): void {
  if (query.has("plain")) return;
  const rectangle = (id: string): DOMRect => element(id).getBoundingClientRect();
  const wide = isWide();
  const [nav, side, time] = [rectangle("toggles"), rectangle("panel"), rectangle("time")];
  const bottom = panelOpen && !wide ? side.top : time.top;
  if (wide)
    stage.setFree(nav.right, nav.top, panelOpen ? window.innerWidth - side.left : 0, window.innerHeight - bottom);
  else stage.setFree(0, nav.bottom, 0, window.innerHeight - bottom);
}
window.addEventListener("resize", layOut);
function setTheme(to: boolean): void {
  dark = to;
  root.dataset.theme = dark ? "dark" : "light";
  stage.setTheme(dark);
}
const firstId = BigInt(Math.floor(Math.random() * 2 ** 52));
let lastId = firstId; // of the messages of this page
function send(module: string, key: string, value: string): void {
  refused("");
  connection.send(protocol.message(++lastId, module, key, value));
}

function click(id: string, key: string | null, text: string, run: () => void): void {
  element(id).addEventListener("click", run);
  if (key !== null) controls.push({ key, text, run });
}
const simulation = new Simulation(send);

click("pause", " ", "Pause or continue the picture only", () => (timeline.paused = !timeline.paused));
click("back", ",", "One sample back", () => timeline.step(-1));
click("forward", ".", "One sample forward", () => timeline.step(1));
click("slow", "s", "Slow motion of the picture", () => {
  timeline.speed = timeline.speed === 1 ? 0.25 : 1;
  timeline.paused = false;
});
click("live", "l", "Back to the present", () => timeline.goLive());
click("halt", "x", "Halt or continue the simulation", () => simulation.halt());
click("sim-step", "z", "One step of the simulation", () => simulation.step());
controls.push({ key: "m", text: "Slow down the simulation, then back to real time", run: () => simulation.slower() });
click("reset", "r", "Start over with objects, hand and recorded motion", () => simulation.startOver());
click("reposition", null, "", () => send("*", "reposition", "now"));
click("panel-button", "p", "Panel", () => setPanel(!panelOpen));
click("theme-button", "t", "Light or dark theme", () => {
  themeChosen = true;
  setTheme(!dark);
});
systemTheme.addEventListener("change", ({ matches }) => {
  if (!themeChosen) setTheme(matches);
});
click("help-button", "?", "Show this list", () => element<HTMLDialogElement>("help").showModal());
controls.push({ key: "v", text: "Initial view", run: () => stage.lookAtDefault() });
click("save", null, "", () => {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(timeline.save());
  link.download = "softhand.shv";
  link.click();
  URL.revokeObjectURL(link.href);
});
element<HTMLInputElement>("open").onchange = async ({ target }) => {
  const input = target as HTMLInputElement;
  const file = input.files?.[0];
  input.value = ""; // so that the same file can be opened again
  if (!file) return;
  refused("");
  try {
    timeline.open(await file.arrayBuffer());
  } catch (error) {
    refused(`${file.name} was not opened: ${error instanceof Error ? error.message : error}`);
  }
};
/** Shows the reason why a request of the user failed. An empty text hides it. */
function refused(text: string): void {
  element("refused").textContent = text;
  element("refused").hidden = text === "";
}
const scrub = element<HTMLInputElement>("scrub");
scrub.oninput = () => timeline.seek(Number(scrub.value) / 1000);
element<HTMLFormElement>("message").onsubmit = (event) => {
  event.preventDefault();
  const data = new FormData(event.target as HTMLFormElement);
  send(String(data.get("module")), String(data.get("key")), String(data.get("value")));
};
element("key-list").replaceChildren(
  ...controls.flatMap(({ key, text }) => [
    Object.assign(document.createElement("dt"), { textContent: key === " " ? "Space" : key.toUpperCase() }),
    Object.assign(document.createElement("dd"), { textContent: text }),
  ]),
);
const STEPS = new Set([",", ".", "z"]);
const TURN = 0.08; // rad per key press
const NEARER = 0.93;
const views: Record<string, [number, number, number]> = {
  ArrowLeft: [-TURN, 0, 1],
  ArrowRight: [TURN, 0, 1],
  ArrowUp: [0, TURN, 1],
  ArrowDown: [0, -TURN, 1],
  "+": [0, 0, NEARER],
  "=": [0, 0, NEARER], // the same key without shift on many keyboards
  "-": [0, 0, 1 / NEARER],
};
window.addEventListener("keydown", (event) => {
  const target = event.target as HTMLElement;
  if (
    event.ctrlKey ||
    event.metaKey ||
    event.altKey ||
    target.closest("input:not([type=range], [type=file]), select, dialog")
  )
    return;
  const view = views[event.key];
  // Arrow keys move the slider and scroll the panel if these have the focus.
  if (view && !target.closest("input, #panel")) {
    event.preventDefault();
    stage.orbit(...view);
    return;
  }
  if (event.key === " " && target.closest("button, summary, label")) return;
  const control = controls.find(({ key }) => key === event.key.toLowerCase());
  if (!control) return;
  event.preventDefault();
  // A held key only steps. Repeated switching would end in a random state.
  if (!event.repeat || STEPS.has(control.key)) control.run();
});

const trackerPort = Number(query.get("tracker") ?? 8091);
const headset = new Headset(
  stage.renderer,
  `${socketScheme}://${location.hostname}:${trackerPort}`,
  (mode) => {
    if (mode) root.dataset.session = mode;
    else delete root.dataset.session;
    stage.setSeeThrough(mode === "immersive-ar");
  },
);
for (const [id, mode] of [
  ["enter-vr", "immersive-vr"],
  ["enter-ar", "immersive-ar"],
] as [string, Mode][]) {
  const button = element<HTMLButtonElement>(id);
  void offers(mode).then((offered) => (button.hidden = !offered));
  button.onclick = () =>
    headset.enter(mode).then(
      () => refused(""),
      (error) => refused(`${button.textContent} was refused: ${error instanceof Error ? error.message : error}`),
    );
}

setTheme(dark);
setPanel(panelOpen);
setColouring(colouring);

// ---- every frame of the display ----

let last = performance.now();
let drawnPanel = 0;
function draw(now: number, frame?: XRFrame): void {
  if (frame) headset.frame(now, frame);
  const elapsed = now - last;
  last = now;
  timeline.advance(now, elapsed);
  if (timeline.live)
    for (const { type, instance } of silence.watch(elapsed, simulation.pace, requested)) {
      stage.silence(type, instance);
      if (type === Type.contacts) panel.silence(instance);
    }
  prompts.draw(now, stage.renderer.xr.isPresenting);
  stage.adapt(elapsed);
  stage.render();
  element("blind").hidden = !stage.isBlind;
  ++counts.drawn;
  if (now - drawnPanel > 100) {
    drawnPanel = now;
    if (colouring !== "skin") {
      stage.repaint();
      drawLegend();
    }
    if (panelOpen) panel.draw(now);
    press(element("pause"), timeline.paused);
    press(element("slow"), timeline.speed !== 1);
    element<HTMLButtonElement>("live").disabled = timeline.live;
    if (document.activeElement !== scrub || timeline.live)
      scrub.value = String(timeline.live ? 1000 : Math.round(1000 * timeline.part));
    scrub.title = `${timeline.seconds.toFixed(0)} s kept`;
  }
}
// The animation loop of the window or, in a session, of the headset.
stage.renderer.setAnimationLoop(draw);

declare global {
  interface Window {
    /** Access for tests and `softhand render`. */
    softhand: {
      counts: typeof counts;
      handCount: () => number;
      programCount: () => number;
      fixResolution: (scale: number) => void;
      seek: (seconds: number) => void;
      signIsVisible: () => boolean;
    };
  }
}
window.softhand = {
  counts,
  handCount: () => stage.handCount,
  programCount: () => stage.renderer.info.programs?.length ?? 0,
  fixResolution: (scale) => stage.resolution.fix(scale),
  seek: (seconds) => timeline.seekTime(seconds),
  signIsVisible: () => prompts.sign.visible,
};
