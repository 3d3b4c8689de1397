// What a person is asked to do, with a countdown: large on the page and, in a headset, on a sign behind the objects.
import * as THREE from "three";
import { element } from "./panel";
import type { Prompt } from "./protocol";

// A prompt whose time is over vanishes after this time (s), because its sender has ended without a word.
const KEPT = 1.5;
// Size (m) and place of the sign in the world. A head looks at it from about 0.85 m (headset.ts).
const WIDTH = 0.8;
const HEIGHT = 0.4;
const PLACE = [0, 0.45, -0.45] as const;
const PIXELS = 1024; // of the width
const LINE = 120; // pixels

export class PromptSign {
  readonly sign: THREE.Mesh;
  private readonly canvas = document.createElement("canvas");
  private readonly texture: THREE.CanvasTexture;
  private prompt: Prompt = { seconds: 0, text: "" };
  private shownAt = 0;
  private drawn = "";

  constructor() {
    this.canvas.width = PIXELS;
    this.canvas.height = (PIXELS * HEIGHT) / WIDTH;
    this.texture = new THREE.CanvasTexture(this.canvas);
    this.texture.colorSpace = THREE.SRGBColorSpace;
    this.sign = new THREE.Mesh(
      new THREE.PlaneGeometry(WIDTH, HEIGHT),
      new THREE.MeshBasicMaterial({ map: this.texture, fog: false, toneMapped: false }),
    );
    this.sign.position.set(...PLACE);
    this.sign.visible = false;
  }

  show(prompt: Prompt, now: number): void {
    this.prompt = prompt;
    this.shownAt = now;
  }

  /** Call it for every picture. `inHeadset`: the picture is for a headset, which does not show the page. */
  draw(now: number, inHeadset: boolean): void {
    // `now` is the start of the picture, and a prompt can arrive after it.
    const left = this.prompt.seconds - Math.max(0, now - this.shownAt) / 1000;
    const text = left > -KEPT ? this.prompt.text : "";
    this.sign.visible = inHeadset && text !== "";
    const seconds = String(Math.max(0, Math.ceil(left)));
    const content = text === "" ? "" : `${text}\n${seconds}`;
    if (content === this.drawn) return;
    this.drawn = content;
    element("prompt").hidden = text === "";
    element("prompt-text").textContent = text;
    element("prompt-seconds").textContent = seconds;
    if (text !== "") this.paint(text, seconds);
  }

  private paint(text: string, seconds: string): void {
    const context = this.canvas.getContext("2d")!;
    context.fillStyle = "#14171c";
    context.fillRect(0, 0, this.canvas.width, this.canvas.height);
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillStyle = "#ffffff";
    context.font = `${0.75 * LINE}px sans-serif`;
    const lines: string[] = [];
    for (const word of text.split(" ")) {
      const longer = lines.length > 0 ? `${lines.at(-1)} ${word}` : word;
      if (lines.length > 0 && context.measureText(longer).width < 0.94 * PIXELS) lines[lines.length - 1] = longer;
      else lines.push(word);
    }
    lines.forEach((line, i) => context.fillText(line, PIXELS / 2, (i + 0.6) * LINE));
    context.fillStyle = "#ffd23f";
    context.font = `bold ${LINE}px sans-serif`;
    context.fillText(seconds, PIXELS / 2, this.canvas.height - 0.6 * LINE);
    this.texture.needsUpdate = true;
  }
}
