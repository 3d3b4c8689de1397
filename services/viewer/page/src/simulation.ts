// The simulation's own clock and start, for all processes of the rig: halt, single steps, slow motion, start over. What it shows comes from the modules'
// status, so that every page, and `softhand send`, sees and steers the same.
import { element } from "./panel";
import type { Status } from "./protocol";

const PACES: [number, string][] = [
  [1, "real time"],
  [0.5, "½"],
  [0.25, "¼"],
  [0.1, "⅒"],
  [0.02, "1/50"],
];

export class Simulation {
  private pace = 1;
  private running = 1; // to which a halted simulation goes back
  private handRate = 90; // Hz

  constructor(private readonly send: (module: string, key: string, value: string) => void) {
    const select = element<HTMLSelectElement>("pace");
    select.replaceChildren(...PACES.map(([pace, text]) => new Option(text, String(pace))));
    select.onchange = () => this.send("*", "pace", select.value);
  }

  status(status: Status): void {
    const pace = status.counters.find(({ name }) => name === "pace")?.value;
    if (pace === undefined) return;
    if (status.energies.length > 1) this.handRate = status.nominalRate;
    if (pace === this.pace) return;
    this.pace = pace;
    if (pace > 0) this.running = pace;
    const select = element<HTMLSelectElement>("pace");
    if (document.activeElement !== select) select.value = String(this.running);
    element("halt").setAttribute("aria-pressed", String(pace === 0));
    const badge = element("pace-badge");
    badge.hidden = pace === 1;
    badge.textContent = pace === 0 ? "simulation halted" : `simulation at ${PACES.find(([known]) => known === pace)?.[1] ?? pace.toPrecision(2)}`;
  }

  halt(): void {
    this.send("*", "pace", String(this.pace === 0 ? this.running : 0));
  }

  /** One step of the hand, then halted. */
  step(): void {
    this.send("*", "advance", (1 / this.handRate).toPrecision(9));
  }

  /** To the next slower pace; from the slowest back to real time. */
  slower(): void {
    const at = PACES.findIndex(([pace]) => pace <= this.running);
    this.send("*", "pace", String(PACES[(at + 1) % PACES.length]![0]));
  }

  startOver(): void {
    this.send("*", "reset", "now");
  }
}
