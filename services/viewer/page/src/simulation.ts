// Controls of the simulation itself, with effect for all viewers: halt, single steps, slow motion, start over, scene,
// tracker, and the motors of the devices. The shown state comes from the status of the modules. Therefore all pages and
// `softhand send` show and control the same state.
import { remember } from "./bounded";
import { MOST_MODULES, element } from "./panel";
import type { Choice, Status } from "./protocol";

const PACES: [number, string][] = [
  [1, "real time"],
  [0.5, "½"],
  [0.25, "¼"],
  [0.1, "⅒"],
  [0.02, "1/50"],
];

export class Simulation {
  pace = 1; // 0: halted
  private running = 1; // pace to which a halted simulation returns
  private handRate = 90; // Hz
  private readonly devices = new Map<string, HTMLElement>();

  constructor(private readonly send: (module: string, key: string, value: string) => void) {
    const select = element<HTMLSelectElement>("pace");
    select.replaceChildren(...PACES.map(([pace, text]) => new Option(text, String(pace))));
    select.onchange = () => this.send("*", "pace", select.value);
  }

  status(status: Status): void {
    const motors = status.lists.counters.find(({ name }) => name === "motors");
    if (motors) this.device(status.module, motors.value !== 0);
    const pace = status.lists.counters.find(({ name }) => name === "pace")?.value;
    if (pace === undefined) return;
    if (status.numbers.iterations > 0) this.handRate = status.numbers.nominal_rate_hz;
    if (pace === this.pace) return;
    this.pace = pace;
    if (pace > 0) this.running = pace;
    const select = element<HTMLSelectElement>("pace");
    if (document.activeElement !== select) select.value = String(this.running);
    element("halt").setAttribute("aria-pressed", String(pace === 0));
    const badge = element("pace-badge");
    badge.hidden = pace === 1;
    badge.textContent =
      pace === 0
        ? "simulation halted"
        : `simulation at ${PACES.find(([known]) => known === pace)?.[1] ?? pace.toPrecision(2)}`;
  }

  halt(): void {
    this.send("*", "pace", String(this.pace === 0 ? this.running : 0));
  }

  /** Makes one step of the hand and halts. */
  step(): void {
    this.send("*", "advance", (1 / this.handRate).toPrecision(9));
  }

  /** Selects the next slower pace. After the slowest it returns to real time. */
  slower(): void {
    const [pace] = PACES.find(([pace]) => pace < this.running) ?? PACES[0]!;
    this.send("*", "pace", String(pace));
  }

  startOver(): void {
    this.send("*", "reset", "now");
  }

  /** Shows the choices that `softhand up` offers: scenes, trackers. A choice restarts the processes of the rig. */
  offer(offered: Choice[]): void {
    const offers = new Map<string, Choice[]>();
    for (const each of offered) offers.set(each.what, [...(offers.get(each.what) ?? []), each]);
    element("offers").hidden = false;
    for (const [what, choices] of offers) {
      let select = document.getElementById(`offer-${what}`) as HTMLSelectElement | null;
      if (!select) {
        const created = Object.assign(document.createElement("select"), {
          id: `offer-${what}`,
          title: `Restart the processes with this ${what}`,
        });
        created.onchange = () => {
          this.send("rig", what, created.value);
          created.blur();
        };
        const label = document.createElement("label");
        label.append(`${what} `, created);
        element("offers").append(label);
        select = created;
      }
      const names = choices.map(({ choice }) => choice);
      if ([...select.options].map(({ value }) => value).join("\n") !== names.join("\n"))
        select.replaceChildren(...names.map((name) => new Option(name.replaceAll("_", " "), name)));
      if (document.activeElement !== select) select.value = choices.find(({ running }) => running)?.choice ?? "";
    }
  }

  private device(module: string, on: boolean): void {
    let button = this.devices.get(module);
    if (!button) {
      const created = Object.assign(document.createElement("button"), {
        id: `motors-${module}`,
        textContent: `${module} motors`,
        title: "Send commands to this device",
      });
      created.onclick = () =>
        this.send(module, "motors", created.getAttribute("aria-pressed") === "true" ? "off" : "on");
      element("devices").append(created);
      element("devices").hidden = false;
      button = created;
    }
    remember(this.devices, module, button, MOST_MODULES).forEach((old) => old.remove());
    button.setAttribute("aria-pressed", String(on));
  }
}
