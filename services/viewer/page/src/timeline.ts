// The frames of the last seconds, kept in the page. The picture can be paused, stepped, slowed down, saved and opened
// again, while the simulation continues.
import { remember } from "./bounded";
import { type Frame, Type, split } from "./protocol";

const KEPT_SECONDS = 15;
const LOOK_BACK = 600; // frames; within them every stream has a frame
const MOST_STREAMS = 1024;

interface Entry {
  time: number; // ms, arrival
  frame: Frame;
}

// They always show the present, whatever the picture shows.
const PRESENT = new Set([Type.status, Type.choices, Type.reply, Type.gateway]);
// Data that a display needs once.
const DESCRIPTIONS = new Set([Type.handDescription, Type.objectDescription, Type.softDescription]);
const key = (frame: Frame): number => frame.type * 65536 + frame.instance;

export class Timeline {
  private entries: Entry[] = [];
  private descriptions = new Map<number, Frame>();
  private newest = new Map<number, Entry>(); // newest entry of each stream, whatever is shown
  private missed = new Map<number, Entry>(); // newest entry of each stream that was not kept during a long pause
  private cursor = 0; // the entries before it are shown
  private clock = 0; // ms, time of the picture; lags behind the newest entry in slow motion
  paused = false;
  speed = 1;
  private stale = false; // the picture belongs to an earlier stream,
  private past = new Map<number, Frame>(); // and these are its descriptions
  private opened: Frame[] | null = null; // descriptions of the opened file that is shown instead of the stream

  /**
   * `apply` shows a frame; it gets the newest frame of each stream. `pass` gets every frame in order when time passes
   * it. `clear` empties the picture.
   */
  constructor(
    private readonly apply: (frame: Frame) => void,
    private readonly pass: (frame: Frame) => void,
    private readonly clear: () => void,
  ) {}

  add(time: number, frame: Frame): void {
    const description = DESCRIPTIONS.has(frame.type);
    if (description) remember(this.descriptions, key(frame), frame, MOST_STREAMS);
    // The page's buttons act on modules. Therefore their present state is always applied, whatever the picture shows.
    if (PRESENT.has(frame.type) || (description && !this.opened && !this.stale)) this.apply(frame);
    if (description || PRESENT.has(frame.type)) return;
    remember(this.newest, key(frame), { time, frame }, MOST_STREAMS);
    if (this.opened || this.stale) return;
    // A picture may be paused for hours. Of the frames long after it only the newest are kept, for the time when it
    // continues.
    if (this.paused && time > this.clock + KEPT_SECONDS * 1000) {
      remember(this.missed, key(frame), { time, frame }, MOST_STREAMS);
      return;
    }
    this.catchUp();
    this.entries.push({ time, frame });
  }

  get live(): boolean {
    return !this.paused && this.speed === 1 && !this.opened;
  }

  /** Shows the frames that are due. `elapsed` is in ms since the last call. */
  advance(now: number, elapsed: number): void {
    if (!this.opened && !this.paused) {
      if (this.stale) this.begin(now);
      this.catchUp();
    }
    if (this.live) {
      this.runTo(this.entries.length);
      this.clock = now;
    } else if (!this.paused) {
      this.clock += elapsed * this.speed;
      let end = this.cursor;
      while (end < this.entries.length && this.entries[end]!.time <= this.clock) ++end;
      this.runTo(end);
      if (this.opened && end === this.entries.length) this.seek(0);
    }
    if (this.opened) return;
    let old = 0;
    while (old < this.entries.length && this.entries[old]!.time < now - KEPT_SECONDS * 1000) ++old;
    // A paused picture keeps its frames although they become old.
    if (this.paused) old = Math.min(old, Math.max(0, this.cursor - LOOK_BACK));
    if (old < 200) return;
    this.entries.splice(0, old);
    this.cursor = Math.max(0, this.cursor - old);
    const first = this.entries[0];
    if (first && this.clock < first.time) this.clock = first.time;
  }

  /**
   * Moves by one sample, forward (+1) or back (-1), of the first of the kept streams. Other frames up to the next
   * sample are included. Pauses.
   */
  step(direction: 1 | -1): void {
    this.paused = true;
    const first = this.entries.reduce((least, { frame }) => Math.min(least, key(frame)), Infinity);
    const find = (at: number, by: 1 | -1): number => {
      while (at >= 0 && at < this.entries.length && key(this.entries[at]!.frame) !== first) at += by;
      return at;
    };
    const at = direction > 0 ? find(this.cursor, 1) : find(find(this.cursor - 1, -1) - 1, -1);
    if (at >= 0 && at < this.entries.length) this.show(find(at + 1, 1));
  }

  /** Moves to a fraction 0..1 of the kept entries. Pauses the stream. */
  seek(part: number): void {
    if (!this.opened) this.paused = true;
    this.show(Math.round(part * this.entries.length));
  }

  /** Moves to a time (s) of an opened file. */
  seekTime(seconds: number): void {
    this.paused = true;
    const end = this.entries.findIndex(({ time }) => time > 1000 * seconds);
    this.show(end < 0 ? this.entries.length : end);
  }

  get part(): number {
    return this.entries.length === 0 ? 1 : this.cursor / this.entries.length;
  }

  get seconds(): number {
    const first = this.entries[0];
    return first ? (this.entries.at(-1)!.time - first.time) / 1000 : 0;
  }

  goLive(): void {
    if (this.opened) {
      this.opened = null;
      this.stale = true;
    }
    this.paused = false;
    this.speed = 1;
  }

  /** Another stream starts now. A paused picture stays. */
  forget(): void {
    if (!this.stale) this.past = this.descriptions;
    this.descriptions = new Map();
    this.newest.clear();
    this.stale = true;
  }

  /**
   * Returns the kept frames as a file. After "SHVR" and the version it has for each frame the time (f64 ms), the length
   * (u32) and the frame.
   */
  save(): Blob {
    const parts: BlobPart[] = [new Uint8Array([0x53, 0x48, 0x56, 0x52, 1, 0, 0, 0])];
    const first = this.entries[0]?.time ?? 0;
    const put = (time: number, frame: Frame): void => {
      const head = new DataView(new ArrayBuffer(12));
      const bytes = new Uint8Array(frame.payload.buffer, frame.payload.byteOffset - 16, frame.payload.byteLength + 16);
      head.setFloat64(0, time, true);
      head.setUint32(8, bytes.length, true);
      parts.push(head.buffer as ArrayBuffer, bytes.slice());
    };
    for (const frame of this.opened ?? (this.stale ? this.past : this.descriptions).values()) put(0, frame);
    for (const { time, frame } of this.entries) put(time - first, frame);
    return new Blob(parts, { type: "application/octet-stream" });
  }

  /** Plays a saved file repeatedly. Throws if the file is not a recording. */
  open(file: ArrayBuffer): void {
    const view = new DataView(file);
    if (file.byteLength < 8 || view.getUint32(0, true) !== 0x52564853 || view.getUint32(4, true) !== 1)
      throw new Error("no recording of this page");
    const entries: Entry[] = [];
    const descriptions: Frame[] = [];
    for (let at = 8; at < file.byteLength; ) {
      const length = at + 12 <= file.byteLength ? view.getUint32(at + 8, true) : Infinity;
      if (at + 12 + length > file.byteLength) throw new Error("the recording is cut off");
      const time = view.getFloat64(at, true);
      // A frame with such a time would never be shown.
      if (!Number.isFinite(time)) throw new Error("a time of the recording is not a number");
      for (const frame of split(file.slice(at + 12, at + 12 + length))) {
        if (DESCRIPTIONS.has(frame.type)) descriptions.push(frame);
        else entries.push({ time, frame });
      }
      at += 12 + length;
    }
    this.entries = entries;
    this.missed.clear();
    this.opened = descriptions;
    this.paused = false;
    this.cursor = 0;
    this.clock = 0;
    this.clear();
    descriptions.forEach(this.apply);
  }

  private begin(now: number): void {
    this.stale = false;
    this.entries = [];
    this.cursor = 0;
    this.clock = now;
    // A halted simulation sends no new frames, so show the newest ones.
    this.missed = new Map(this.newest);
    this.clear();
    for (const frame of this.descriptions.values()) this.apply(frame);
  }

  private catchUp(): void {
    this.entries.push(...[...this.missed.values()].sort((a, b) => a.time - b.time));
    this.missed.clear();
  }

  private runTo(end: number): void {
    for (let i = this.cursor; i < end; ++i) this.pass(this.entries[i]!.frame);
    if (end > this.cursor) this.applyNewest(this.cursor, end);
    this.cursor = end;
  }

  private show(cursor: number): void {
    this.cursor = cursor;
    this.clock = this.entries[Math.max(0, cursor - 1)]?.time ?? 0;
    this.applyNewest(Math.max(0, cursor - LOOK_BACK), cursor);
  }

  private applyNewest(begin: number, end: number): void {
    const newest = new Map<number, Frame>();
    for (let i = begin; i < end; ++i) newest.set(key(this.entries[i]!.frame), this.entries[i]!.frame);
    newest.forEach((frame) => this.apply(frame));
  }
}
