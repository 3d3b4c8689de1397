// Immersive sessions: the scene in a headset, and the headset's hands on their way to the tracker (xr.ts). docs/tracker-webxr.md.
/// <reference types="webxr" />
import * as THREE from "three";
import { HandSender } from "./xr";

export type Mode = "immersive-vr" | "immersive-ar";

// Where the world's origin is put as seen from the head at the start, m: scenes have their table there, and a table is about there.
const ORIGIN_AHEAD = 0.4;
const ORIGIN_BELOW = 0.45;

/** Whether this browser offers `mode`; never rejects. */
export async function offers(mode: Mode): Promise<boolean> {
  try {
    return (await navigator.xr?.isSessionSupported(mode)) ?? false;
  } catch {
    return false; // A permissions policy forbids it.
  }
}

/** One session at a time. */
export class Headset {
  private base: XRReferenceSpace | null = null;
  private world: XRReferenceSpace | null = null;
  private sender: HandSender | null = null;
  private busy = false;

  /** `tracker`: WebSocket address of softhand-tracker-webxr. `changed`: told the mode of a session that begins, null at its end. */
  constructor(
    private readonly renderer: THREE.WebGLRenderer,
    private readonly tracker: string,
    private readonly changed: (mode: Mode | null) => void,
  ) {}

  /** Of a user's click, as browsers demand. Rejects when the session is refused. */
  async enter(mode: Mode): Promise<void> {
    if (this.busy) return;
    this.busy = true;
    let session: XRSession | null = null;
    try {
      session = await navigator.xr!.requestSession(mode, { optionalFeatures: ["hand-tracking"] });
      session.addEventListener("end", () => this.leave(), { once: true });
      // Every immersive session grants `local`; the floor's height is not needed, for the world is placed by the head.
      const base = await session.requestReferenceSpace("local");
      base.addEventListener("reset", () => (this.world = null));
      this.base = base;
      this.renderer.xr.enabled = true;
      this.renderer.xr.setReferenceSpaceType("local");
      this.sender = new HandSender(this.tracker);
      this.changed(mode);
      await this.renderer.xr.setSession(session);
    } catch (error) {
      if (session) await session.end().catch(() => {});
      this.busy = false;
      throw error;
    }
  }

  /** Of every frame of a session: places the world where the head is first seen, then sends the hands in the world's frame. */
  frame(time: number, frame: XRFrame): void {
    if (!this.base) return;
    if (!this.world) {
      const head = frame.getViewerPose(this.base);
      if (!head) return;
      this.world = this.base.getOffsetReferenceSpace(originBefore(head.transform));
      this.renderer.xr.setReferenceSpace(this.world);
    }
    this.sender?.send(time, frame, this.world);
  }

  private leave(): void {
    this.sender?.stop();
    this.sender = this.base = this.world = null;
    this.busy = false;
    this.changed(null);
  }
}

/** The world's origin in front of and below `head`, upright, its -Z the way the head looks; a head that looks up or down keeps its heading. */
function originBefore({ position, orientation: { x, y, z, w } }: XRRigidTransform): XRRigidTransform {
  // Heading from the head's right-hand side, which stays level when it nods.
  const right = new THREE.Vector3(1, 0, 0).applyQuaternion(new THREE.Quaternion(x, y, z, w));
  const heading = Math.atan2(-right.z, right.x);
  return new XRRigidTransform(
    { x: position.x - ORIGIN_AHEAD * Math.sin(heading), y: position.y - ORIGIN_BELOW, z: position.z - ORIGIN_AHEAD * Math.cos(heading) },
    { x: 0, y: Math.sin(heading / 2), z: 0, w: Math.cos(heading / 2) },
  );
}
