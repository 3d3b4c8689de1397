// Immersive sessions: shows the scene in a headset and sends the headset's hands to the tracker (xr.ts).
// See services/trackers/webxr/README.md.
/// <reference types="webxr" />
import * as THREE from "three";
import { HandSender } from "./xr";

export type Mode = "immersive-vr" | "immersive-ar";

// Place of the world's origin relative to the head at the start, m. Scenes have their table at the origin, and a real
// table has about this place.
const ORIGIN_AHEAD = 0.4;
const ORIGIN_BELOW = 0.45;

/** Returns whether this browser offers `mode`. Never rejects. */
export async function offers(mode: Mode): Promise<boolean> {
  try {
    return (await navigator.xr?.isSessionSupported(mode)) ?? false;
  } catch {
    return false; // a permissions policy forbids it
  }
}

/** At most one session at a time. */
export class Headset {
  private base: XRReferenceSpace | null = null;
  private world: XRReferenceSpace | null = null;
  private sender: HandSender | null = null;
  private busy = false;

  /**
   * `tracker`: WebSocket address of softhand-tracker-webxr. `changed` gets the mode when a session begins, null when it
   * ends.
   */
  constructor(
    private readonly renderer: THREE.WebGLRenderer,
    private readonly tracker: string,
    private readonly changed: (mode: Mode | null) => void,
  ) {}

  /** Call it in the handler of a user's click, as browsers demand. Rejects if the session is refused. */
  async enter(mode: Mode): Promise<void> {
    if (this.busy) return;
    this.busy = true;
    let session: XRSession | null = null;
    try {
      session = await navigator.xr!.requestSession(mode, { optionalFeatures: ["hand-tracking"] });
      session.addEventListener("end", () => this.leave(), { once: true });
      // Every immersive session grants `local`. The height of the floor is not needed, because the head determines the
      // place of the world.
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

  /**
   * Call it for every frame of a session. Places the world relative to the first head pose, then sends the hands in the
   * world's frame.
   */
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

/**
 * The world's origin in front of and below `head`, upright, with -Z in the direction of view. Up and down are ignored.
 */
function originBefore({ position, orientation: { x, y, z, w } }: XRRigidTransform): XRRigidTransform {
  // Take the heading from the head's right axis, which stays level when the head nods.
  const right = new THREE.Vector3(1, 0, 0).applyQuaternion(new THREE.Quaternion(x, y, z, w));
  const heading = Math.atan2(-right.z, right.x);
  return new XRRigidTransform(
    {
      x: position.x - ORIGIN_AHEAD * Math.sin(heading),
      y: position.y - ORIGIN_BELOW,
      z: position.z - ORIGIN_AHEAD * Math.cos(heading),
    },
    { x: 0, y: Math.sin(heading / 2), z: 0, w: Math.cos(heading / 2) },
  );
}
