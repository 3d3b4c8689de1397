// Finds the streams that ended while the picture showed the present. Their last frames must not pass for the present.
import { remember } from "./bounded";
import type { Type } from "./protocol";

const SILENT_AFTER = 1500; // ms
// ms between two pictures. A page that stalls longer must not take its own stall for the end of all streams.
const LONGEST = 250;
const MOST = 1024;

interface Stream {
  type: Type;
  instance: number;
}

export class Silence {
  private clock = 0; // ms that the page watched, in the time of the simulation
  private readonly heard = new Map<string, Stream & { time: number }>();

  /** A frame of this stream was shown. */
  hear({ type, instance }: Stream): void {
    remember(this.heard, `${type} ${instance}`, { type, instance, time: this.clock }, MOST);
  }

  /**
   * Call it for each picture of the present. `elapsed`: ms since the last one. A slow simulation sends rarely, and a
   * halted one (`pace` 0) nothing. Streams of other types than `requested` are not sent. Returns the streams that have
   * just ended.
   */
  watch(elapsed: number, pace: number, requested: Type[]): Stream[] {
    const passed = Math.min(elapsed, LONGEST) * Math.min(1, pace);
    this.clock += passed;
    const ended: Stream[] = [];
    for (const [key, stream] of this.heard) {
      if (!requested.includes(stream.type)) stream.time += passed;
      if (this.clock - stream.time <= SILENT_AFTER) continue;
      this.heard.delete(key);
      ended.push(stream);
    }
    return ended;
  }
}
