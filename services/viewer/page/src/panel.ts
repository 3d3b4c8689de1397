// Figures beside the picture: one row per module, the hand's solver, and plots of the last seconds.
import { remember } from "./bounded";
import { type Contacts, type GatewayState, type Reply, type Status, FINGERS } from "./protocol";

const PLOT_SECONDS = 10;
export const MOST_HANDS = 32;
export const MOST_MODULES = 128;
/** Colours of Okabe and Ito, which most people can distinguish. */
const FINGER_COLOURS = ["#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#7f7f7f"];

export const element = <T extends HTMLElement>(id: string): T => document.getElementById(id) as T;
const fixed = (value: number, digits: number): string => (value === 0 ? "0" : value.toFixed(digits));

const energy = (joules: number): string =>
  Math.abs(joules) >= 1
    ? `${joules.toFixed(2)} J`
    : `${(1000 * joules).toFixed(Math.abs(joules) >= 0.1 ? 0 : Math.abs(joules) >= 0.01 ? 1 : 2)} mJ`;
/** An entry of the energy ledger. It may be small compared with the others. */
const ledgerText = (joules: number): string =>
  joules !== 0 && Math.abs(joules) < 5e-6 ? `${joules.toExponential(0)} J` : energy(joules);
const millimetres = (metres: number, digits: number): string => `${fixed(1000 * metres, digits)} mm`;
/** Age of an input in ms. Ages from 1 s on are shown in seconds. */
const age = (ms: number): string => (ms < 0 ? "–" : ms < 1000 ? fixed(ms, 1) : `${(ms / 1000).toFixed(0)} s`);
const words = (name: string): string => name.replaceAll("_", " ");

/** A tag with a text. `field` is the name of the figure of a status. */
function tag(name: string, text: string, field?: string): HTMLElement {
  const made = Object.assign(document.createElement(name), { textContent: text });
  if (field !== undefined) made.dataset.field = field;
  return made;
}

/** A coloured dot before a name, because not every colour is readable as text colour. */
export function swatch(colour: string): HTMLElement {
  const dot = Object.assign(document.createElement("span"), { className: "swatch" });
  dot.style.background = colour;
  return dot;
}

/** The quantities of a loop that computes physics, as in `softhand status`. Unfolded if the loop has a solver. */
class Physics {
  private readonly details = document.createElement("details");
  private readonly figures = document.createElement("dl");
  private readonly energies = document.createElement("div");
  private readonly ledger = document.createElement("dl");
  private readonly books = document.createElement("h4");
  private energyTop = 1e-6;

  constructor({ module, numbers }: Status) {
    const { details } = this;
    const solves = numbers.iterations > 0;
    details.open = solves;
    details.dataset.module = module;
    this.energies.setAttribute("role", "img");
    this.energies.setAttribute("aria-label", "Stored energy by term");
    this.books.textContent = "Energy since its start";
    this.books.title = "stored = initial + work + anchoring - friction - damping - integrator + residual";
    const title = solves ? `${words(module)}: solver and energy` : words(module);
    details.append(tag("summary", title), this.figures, this.energies, this.books, this.ledger);
    if (solves) element("physics").prepend(details);
    else element("physics").append(details);
  }

  remove(): void {
    this.details.remove();
  }

  show(status: Status): void {
    const { numbers, texts, lists } = status;
    const figures: [string, string][] = [];
    const { residual } = numbers;
    if (numbers.iterations > 0)
      figures.push(
        ["residual", `${residual < 1e-3 ? residual.toExponential(1) : residual.toPrecision(3)} N`],
        ["iterations", String(numbers.iterations)],
        ["contacts", String(numbers.contact_count)],
        ["penetration", millimetres(numbers.penetration, 3)],
        ["inverted", String(numbers.inverted_elements)],
        ["steps", String(numbers.steps)],
      );
    if (numbers.coupling_stretch > 0) figures.push(["coupling stretch", millimetres(numbers.coupling_stretch, 2)]);
    if (numbers.passivity_energy !== 0) figures.push(["passivity", energy(numbers.passivity_energy)]);
    if (texts.second_writer !== "") figures.push(["second writer of", texts.second_writer]);
    // Counters other than zero.
    for (const { name, value } of lists.counters)
      if (value !== 0 && !(name === "pace" && value === 1))
        figures.push([words(name), String(Number(value.toPrecision(10)))]);
    this.figures.replaceChildren(...figures.flatMap(([name, text]) => [tag("dt", name), tag("dd", text, name)]));

    this.energyTop = Math.max(0.98 * this.energyTop, 1e-6, ...lists.energies.map(({ value }) => Math.abs(value)));
    this.energies.replaceChildren(
      ...lists.energies.map(({ name, value }) => {
        const bar = Object.assign(document.createElement("div"), { className: "bar", title: words(name) });
        const fill = document.createElement("i");
        // The square root makes small terms visible beside large ones.
        fill.style.width = `${100 * Math.sqrt(Math.min(1, Math.abs(value) / this.energyTop))}%`;
        bar.append(tag("span", words(name)), fill, tag("span", energy(value), name));
        return bar;
      }),
    );
    this.books.hidden = lists.ledger.length === 0;
    this.ledger.replaceChildren(
      ...lists.ledger.flatMap(({ name, value }) => [
        tag("dt", words(name)),
        tag("dd", ledgerText(value), `ledger ${name}`),
      ]),
    );
  }
}

const forcesOf = (fingers: Contacts["fingers"]): number[] =>
  fingers.map(({ force }) => Math.hypot(force[0]!, force[1]!, force[2]!));

class Plot {
  readonly canvas = Object.assign(document.createElement("canvas"), { className: "plot" });
  private readonly samples: { time: number; values: number[] }[] = [];
  constructor(
    private readonly colours: string[],
    private readonly least: number,
  ) {}

  add(time: number, values: number[]): void {
    // A file that plays again, or another file, goes back in time.
    while (this.samples.length > 0 && this.samples.at(-1)!.time >= time) this.samples.pop();
    this.samples.push({ time, values });
    while (this.samples.length > 0 && this.samples[0]!.time < time - PLOT_SECONDS) this.samples.shift();
  }

  draw(): void {
    const { canvas, samples } = this;
    if (canvas.clientWidth === 0) return;
    const ratio = window.devicePixelRatio;
    const width = (canvas.width = Math.round(canvas.clientWidth * ratio));
    const height = (canvas.height = Math.round(canvas.clientHeight * ratio));
    // Such a canvas is drawn by the processor, which is faster if WebGL is drawn in software too.
    const context = canvas.getContext("2d", { willReadFrequently: true })!;
    const style = getComputedStyle(canvas);
    let top = this.least;
    for (const { values } of samples) top = Math.max(top, ...values);
    const y = (value: number): number => height - 2 - (value / top) * (height - 14 * ratio);
    context.font = `${10 * ratio}px sans-serif`;
    context.strokeStyle = style.getPropertyValue("--line");
    context.fillStyle = style.getPropertyValue("--faint");
    for (const part of [0, 0.5, 1]) {
      context.beginPath();
      context.moveTo(0, y(part * top));
      context.lineTo(width, y(part * top));
      context.stroke();
      if (part > 0) context.fillText((part * top).toPrecision(2), 2, y(part * top) - 2);
    }
    const last = samples.at(-1);
    if (!last) return;
    const x = (time: number): number => width * (1 - (last.time - time) / PLOT_SECONDS);
    // One point for each column of pixels, with the largest value there. Lines through all samples take long to draw.
    const columns: { time: number; values: number[] }[] = [];
    for (const { time, values } of samples) {
      const column = columns.at(-1);
      if (column && Math.floor(x(column.time)) === Math.floor(x(time)))
        column.values = column.values.map((value, i) => Math.max(value, values[i]!));
      else columns.push({ time, values });
    }
    context.lineWidth = 1.5 * ratio;
    this.colours.forEach((colour, i) => {
      context.strokeStyle = colour;
      context.beginPath();
      for (const { time, values } of columns) context.lineTo(x(time), y(values[i]!));
      context.stroke();
    });
  }
}

/** Forces and penetration of one hand. Its name is hidden while there is only one. */
class HandFigures {
  private readonly force = new Plot(FINGER_COLOURS, 0.5);
  private readonly penetration = new Plot(["#0072b2"], 0.2);
  private readonly values = FINGERS.map((finger) => {
    const value = tag("b", "0");
    value.dataset.finger = finger;
    return value;
  });
  private readonly parts: HTMLElement[];

  constructor(instance: number) {
    const user = Math.floor(instance / 2);
    const name = (instance % 2 === 0 ? "left hand" : "right hand") + (user === 0 ? "" : ` of user ${user}`);
    const keys = Object.assign(document.createElement("p"), { className: "key" });
    FINGERS.forEach((finger, i) => {
      const key = document.createElement("span");
      key.append(swatch(FINGER_COLOURS[i]!), `${finger} `, this.values[i]!);
      keys.append(key);
    });
    const part = (id: string, ...content: HTMLElement[]): HTMLElement => {
      const made = Object.assign(document.createElement("div"), { className: "hand" });
      made.dataset.hand = String(instance);
      made.append(tag("h4", name), ...content);
      const others = [...element(id).children] as HTMLElement[];
      element(id).insertBefore(made, others.find((other) => Number(other.dataset.hand) > instance) ?? null);
      return made;
    };
    this.parts = [part("forces", this.force.canvas, keys), part("penetrations", this.penetration.canvas)];
  }

  remove(): void {
    for (const part of this.parts) part.remove();
  }

  silence(silent: boolean): void {
    for (const part of this.parts) part.classList.toggle("silent", silent);
  }

  show({ fingers }: Contacts): void {
    forcesOf(fingers).forEach((force, i) => (this.values[i]!.textContent = force.toFixed(2)));
    this.silence(false);
  }

  plot({ stamp, fingers, contacts }: Contacts): void {
    this.force.add(stamp.sample, forcesOf(fingers));
    this.penetration.add(stamp.sample, [
      1000 * contacts.reduce((deepest, { penetration }) => Math.max(deepest, penetration), 0),
    ]);
  }

  draw(): void {
    this.force.draw();
    this.penetration.draw();
  }
}

interface Module {
  row: HTMLTableRowElement;
  option: HTMLOptionElement;
  physics: Physics | null;
  seen: number;
}

export class Panel {
  private readonly modules = new Map<string, Module>();
  private readonly hands = new Map<number, HandFigures>();

  status(status: Status, now: number): void {
    const { numbers, texts, lists } = status;
    if (numbers.nominal_rate_hz === 0) return; // `softhand up` has no loop
    let known = this.modules.get(status.module);
    if (!known) {
      const row = element<HTMLTableElement>("modules").tBodies[0]!.insertRow();
      row.dataset.module = status.module;
      for (const field of ["module", "rate", "p50", "p99", "p999", "misses", "drops", "age"])
        row.insertCell().dataset.field = field;
      const option = document.createElement("option");
      option.textContent = status.module;
      document.querySelector<HTMLSelectElement>("#message select")!.append(option);
      known = { row, option, physics: null, seen: now };
    }
    for (const old of remember(this.modules, status.module, known, MOST_MODULES)) {
      old.row.remove();
      old.option.remove();
      old.physics?.remove();
    }
    known.seen = now;
    known.row.className = "";
    known.row.dataset.sequence = String(status.stamp.sequence);
    const cells = [
      status.module,
      `${numbers.rate_hz.toFixed(0)}/${numbers.nominal_rate_hz.toFixed(0)}`,
      fixed(numbers.step_ms_p50, 2),
      fixed(numbers.step_ms_p99, 2),
      fixed(numbers.step_ms_p999, 2),
      String(numbers.deadline_misses),
      String(numbers.input_drops),
      age(numbers.input_age_ms),
    ];
    const pace = lists.counters.find(({ name }) => name === "pace")?.value ?? 1;
    cells.forEach((text, i) => (known.row.cells[i]!.textContent = text));
    const slow = numbers.rate_hz > 0 && numbers.rate_hz < 0.9 * pace * numbers.nominal_rate_hz;
    known.row.cells[1]!.classList.toggle("bad", slow);
    known.row.cells[6]!.classList.toggle("bad", texts.second_writer !== "");
    known.row.cells[6]!.title =
      texts.second_writer === "" ? "" : `refused second writer of ${texts.second_writer}`;
    if (!known.physics) {
      const { iterations, coupling_stretch, passivity_energy } = numbers;
      const quantities = [iterations, coupling_stretch, passivity_energy, lists.energies.length, lists.ledger.length];
      if (texts.second_writer === "" && quantities.every((quantity) => quantity === 0)) return;
      known.physics = new Physics(status);
    }
    known.physics.show(status);
  }

  /** Forces of a hand at the time of the shown picture. */
  forces(instance: number, contacts: Contacts): void {
    this.hand(instance).show(contacts);
  }

  /** Adds a sample to the plots of a hand. Call it for every sample in the order of time. */
  plot(instance: number, contacts: Contacts): void {
    this.hand(instance).plot(contacts);
  }

  /** The contacts of this hand come no longer. */
  silence(instance: number): void {
    this.hands.get(instance)?.silence(true);
  }

  /** Removes the figures of all hands. */
  clear(): void {
    for (const hand of this.hands.values()) hand.remove();
    this.hands.clear();
  }

  reply(reply: Reply): void {
    if (reply.result === 0) return;
    const line = document.createElement("li");
    line.textContent = `${reply.module}: ${reply.result === 1 ? "" : "refused, "}${reply.text}`;
    const list = element("replies");
    list.prepend(line);
    while (list.children.length > 20) list.lastChild!.remove();
  }

  gateway(state: GatewayState): void {
    element("gateway").textContent =
      `Gateway: ${state.pages} page${state.pages === 1 ? "" : "s"}, ${(state.bytes / 1e6).toFixed(1)} MB sent` +
      (state.refused > 0 ? `, ${state.refused} refused` : "");
  }

  draw(now: number): void {
    for (const hand of this.hands.values()) hand.draw();
    for (const { row, seen } of this.modules.values()) if (now - seen > 1500) row.className = "silent";
  }

  private hand(instance: number): HandFigures {
    const hand = this.hands.get(instance) ?? new HandFigures(instance);
    remember(this.hands, instance, hand, MOST_HANDS).forEach((old) => old.remove());
    return hand;
  }
}
