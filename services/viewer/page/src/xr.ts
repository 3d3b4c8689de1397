// Sends a headset's hands and head to softhand-tracker-webxr: services/trackers/webxr/README.md.
/// <reference types="webxr" />
const FRAME_BYTES = 1664;
const MAGIC = 0x52584853;
const HAND_BYTES = 804;
const RETRY_MS = 1000;

/** Sends every frame of a session with a visible head or hand. Reconnects automatically until `stop`. */
export class HandSender {
  private socket: WebSocket | null = null;
  private stopped = false;
  private readonly bytes = new ArrayBuffer(FRAME_BYTES);
  private readonly view = new DataView(this.bytes);

  constructor(private readonly url: string) {
    this.connect();
  }

  stop(): void {
    this.stopped = true;
    this.socket?.close();
  }

  /** `time` and `frame` are those of XRSession.requestAnimationFrame. */
  send(time: number, frame: XRFrame, space: XRReferenceSpace): void {
    // Frames that wait in the socket are already late. A newer frame is better.
    if (this.socket?.readyState !== WebSocket.OPEN || this.socket.bufferedAmount > 0) return;
    const view = this.view;
    new Uint8Array(this.bytes).fill(0);
    view.setUint32(0, MAGIC, true);
    view.setUint16(4, 1, true);
    view.setFloat64(8, (frame as XRFrame & { predictedDisplayTime?: number }).predictedDisplayTime ?? time, true);
    const head = frame.getViewerPose(space);
    if (head) {
      view.setUint32(24, 1, true);
      this.pose(28, head.transform);
    }
    for (const source of frame.session.inputSources) {
      if (!source.hand || source.handedness === "none") continue;
      const start = 56 + (source.handedness === "right" ? HAND_BYTES : 0);
      let seen = 0;
      let joint = 0;
      for (const place of source.hand.values()) {
        const pose = frame.getJointPose?.(place, space);
        if (pose) {
          seen |= 1 << joint;
          this.pose(start + 4 + 32 * joint, pose.transform);
          view.setFloat32(start + 32 + 32 * joint, pose.radius ?? 0, true);
        }
        ++joint;
      }
      view.setUint32(start, seen, true);
    }
    view.setFloat64(16, performance.now(), true);
    this.socket.send(this.bytes);
  }

  private pose(at: number, { position: p, orientation: q }: XRRigidTransform): void {
    [p.x, p.y, p.z, q.x, q.y, q.z, q.w].forEach((value, i) => this.view.setFloat32(at + 4 * i, value, true));
  }

  private connect(): void {
    if (this.stopped) return;
    this.socket = new WebSocket(this.url);
    this.socket.onclose = () => window.setTimeout(() => this.connect(), RETRY_MS);
  }
}
