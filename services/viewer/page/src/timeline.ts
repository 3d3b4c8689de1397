// The last seconds of frames, kept in the page: what is shown can be paused, stepped, slowed down, saved and opened again, while the
// simulation goes on undisturbed.
import { type Frame, Type, split } from "./protocol";

const KEPT_SECONDS = 15;
const LOOK_BACK = 600; // frames within which every stream has shown its newest

interface Entry {
  time: number; // ms of arrival
  frame: Frame;
}

const key = (frame: Frame): number => frame.type * 65536 + frame.instance;

export class Timeline {
  private entries: Entry[] = [];
  private descriptions = new Map<number, Frame>();
  private newest = new Map<number, Entry>(); // of each stream, whatever is shown
  private missed = new Map<number, Entry>(); // the newest of each stream since entries are not kept
  private cursor = 0; // entries before it are shown
  private clock = 0; // ms, what is shown; runs behind the newest in slow motion
  paused = false;
  speed = 1;
  private stale = false; // what is shown is none of the present stream's,
  private past = new Map<number, Frame>(); // but described by these
  private opened: Frame[] | null = null; // descriptions of the file that is shown instead of the stream

  /**
   * `apply` shows a frame, of each stream the newest; `pass` is told of every frame that time passes by, in their order; `clear` empties the picture.
   */
  constructor(
    private readonly apply: (frame: Frame) => void,
    private readonly pass: (frame: Frame) => void,
    private readonly clear: () => void,
  ) {}

  add(time: number, frame: Frame): void {
    const description = frame.type === Type.handDescription || frame.type === Type.objectDescription;
    if (description) this.descriptions.set(key(frame), frame);
    // Modules, which the page's buttons act on, are told of as they are now, whatever the picture shows.
    if (frame.type >= Type.status || (description && !this.opened && !this.stale)) this.apply(frame);
    if (description || frame.type >= Type.status) return;
    this.newest.set(key(frame), { time, frame });
    if (this.opened || this.stale) return;
    // A paused picture may stand for hours: of what comes long after it only the newest is kept, for when it goes on.
    if (this.paused && time > this.clock + KEPT_SECONDS * 1000) {
      this.missed.set(key(frame), { time, frame });
      return;
    }
    this.catchUp();
    this.entries.push({ time, frame });
  }

  get live(): boolean {
    return !this.paused && this.speed === 1 && !this.opened;
  }

  /** Shows what is due. `elapsed` in ms since the last call. */
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
    // A paused picture stays though its frames grow old.
    if (this.paused) old = Math.min(old, Math.max(0, this.cursor - LOOK_BACK));
    if (old < 200) return;
    this.entries.splice(0, old);
    this.cursor = Math.max(0, this.cursor - old);
    const first = this.entries[0];
    if (first && this.clock < first.time) this.clock = first.time;
  }

  /** One sample on (+1) or back (-1) of the first of the streams that are kept, with what came between it and the next; pauses. */
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

  /** 0..1 of what is kept; pauses where the stream would run on. */
  seek(part: number): void {
    if (!this.opened) this.paused = true;
    this.show(Math.round(part * this.entries.length));
  }

  /** To a time of an opened file, in seconds of it. */
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

  /** Another stream comes from now on. A paused picture stays. */
  forget(): void {
    if (!this.stale) this.past = this.descriptions;
    this.descriptions = new Map();
    this.newest.clear();
    this.stale = true;
  }

  /** What is kept, as a file: for each frame its time (f64 ms), its length (u32) and itself, after "SHVR" and the version. */
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

  /** Plays a saved file, over and over. Throws where it is none. */
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
      if (!Number.isFinite(time)) throw new Error("a time of the recording is no number"); // which would never come
      for (const frame of split(file.slice(at + 12, at + 12 + length))) {
        if (frame.type === Type.handDescription || frame.type === Type.objectDescription) descriptions.push(frame);
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
    // A simulation that is halted sends nothing more.
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
