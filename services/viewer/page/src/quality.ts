// How finely the page draws: for a computer with a graphics card or without, and as fast as the computer can.

/** low: for computers without a graphics card, and for slow ones. */
export type Quality = "high" | "low";

/** Returns high if a graphics card draws. */
export function bestQuality(): Quality {
  const context = document.createElement("canvas").getContext("webgl2");
  const info = context?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? String(context!.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name) ? "low" : "high";
}

/** Share of the full resolution that is drawn. */
export class Resolution {
  private share = 1;
  private drawTime = 16; // ms, smoothed

  /** `adapts`: to the time that drawing takes. Otherwise all pixels are drawn. */
  constructor(private adapts: boolean) {}

  get scale(): number {
    return this.share;
  }

  /** Reduces the share if `elapsed` (ms between two pictures) stays long, and increases it again if there is time. */
  adapt(elapsed: number): void {
    if (!this.adapts) return;
    this.drawTime += 0.1 * (Math.min(elapsed, 500) - this.drawTime);
    if (this.drawTime > 70 && this.share > 0.5) this.share = Math.max(0.5, this.share - 0.125);
    else if (this.drawTime < 25 && this.share < 1) this.share = Math.min(1, this.share + 0.125);
    else return;
    this.drawTime = 45;
  }

  /** Keeps this share from now on. */
  fix(scale: number): void {
    this.share = scale;
    this.adapts = false;
  }
}
