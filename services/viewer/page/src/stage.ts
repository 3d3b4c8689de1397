// The three.js scene: light, floor, camera, and everything that the topics describe.
// World frame as on the topics: metres, +Y up.
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { RoomEnvironment } from "three/addons/environments/RoomEnvironment.js";
import { remember } from "./bounded";
import { type SkeletonKind, Arrows, Bones, COUPLING_COLOUR, FORCE_COLOUR } from "./glyphs";
import { MOST_HANDS } from "./panel";
import {
  type Bone,
  type Contact,
  type Contacts,
  type Nodes,
  type ObjectDescription,
  type ObjectState,
  type Skeleton,
  type SkinDescription,
  BONES,
  FIRST_SOFT_OBJECT,
  objectInstance,
  Shape,
  Type,
  worldOf,
} from "./protocol";
import { type Quality, Resolution } from "./quality";
import { shapeOf } from "./shapes";
import { type Colouring, Skin } from "./skin";

const OBJECT_COLOURS = [0x4f86c6, 0xe0a030, 0x5aa469, 0xb565a7, 0xd1603d, 0x3fa7a0];
const STATIC_COLOURS = { light: 0x9aa7b4, dark: 0x39424d }; // cool colours, so that the hand stands out
interface Hand {
  skin: Skin | null;
  nodes: Nodes | null;
  contacts: Contact[];
  bones: Record<SkeletonKind, Bones>;
  contactArrows: Arrows;
  fingerArrows: Arrows;
  points: THREE.InstancedMesh<THREE.BufferGeometry, THREE.Material>;
  couplingArrows: Arrows;
}

export interface Shown {
  hand: boolean;
  objects: boolean;
  tracked: boolean;
  intermediate: boolean;
  simulated: boolean;
  contacts: boolean;
  coupling: boolean;
  floor: boolean;
  beside: boolean;
}

export class Stage {
  readonly renderer: THREE.WebGLRenderer;
  private readonly camera = new THREE.PerspectiveCamera(38, 1, 0.01, 20);
  // A camera of its own, so that the page's view does not change during a session.
  private readonly headset = new THREE.PerspectiveCamera(50, 1, 0.02, 20);
  private dark = false;
  private seeThrough = false;
  private readonly controls: OrbitControls;
  private readonly scene = new THREE.Scene();
  private readonly hands = new Map<number, Hand>();
  // By the instance of their description. `placed`: the world lists the object.
  private readonly objects = new Map<number, { mesh: THREE.Mesh; description: ObjectDescription; placed: boolean }>();
  private readonly softObjects = new Map<number, { skin: Skin; nodes: Nodes | null }>();
  private readonly floor: THREE.Mesh;
  private readonly sun = new THREE.DirectionalLight(0xfff1e0, 2.4);
  private readonly sky = new THREE.HemisphereLight(0xffffff, 0xb8a898, 1);
  private shown: Shown;
  private readonly sideDirection = new THREE.Vector3(1, 0, 0); // horizontal, to the right on the screen
  private framed = false;
  private light: THREE.WebGLRenderTarget | null = null; // of the room
  private free = { left: 0, top: 0, right: 0, bottom: 0 };
  readonly resolution: Resolution;
  colouring: Colouring = "skin";
  /** Present end of the colour map: Pa or 1. */
  full = 1;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    shown: Shown,
    private readonly quality: Quality,
  ) {
    this.shown = shown;
    const fine = quality === "high";
    this.resolution = new Resolution(!fine);
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: fine, preserveDrawingBuffer: true });
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = fine ? THREE.PCFSoftShadowMap : THREE.BasicShadowMap;
    this.renderer.toneMapping = THREE.ACESFilmicToneMapping;
    this.renderer.toneMappingExposure = 0.95;
    if (fine) {
      this.lightRoom();
      // The renderer uploads everything again, but this texture was drawn by the lost context.
      canvas.addEventListener("webglcontextrestored", () => this.lightRoom());
    } else {
      this.scene.add(this.sky);
    }
    this.sun.position.set(-0.5, 1.05, 0.3);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.setScalar(fine ? 2048 : 512);
    const area = this.sun.shadow.camera;
    area.left = area.bottom = -0.4;
    area.right = area.top = 0.4;
    area.near = 0.2;
    area.far = 3;
    this.sun.shadow.bias = -0.0004;
    this.sun.shadow.normalBias = 0.0012;
    this.sun.shadow.radius = 5;
    const fill = new THREE.DirectionalLight(0x9fc0ff, 0.5);
    fill.position.set(0.3, 0.5, -0.9);
    this.scene.add(this.sun, this.sun.target, fill);
    this.floor = new THREE.Mesh(
      new THREE.CircleGeometry(3, 64).rotateX(-Math.PI / 2),
      new THREE.MeshStandardMaterial({ roughness: 0.95, metalness: 0 }),
    );
    this.floor.receiveShadow = true;
    this.scene.add(this.floor);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.minDistance = 0.08;
    this.controls.maxDistance = 3;
    this.lookAtDefault();
    this.setTheme(false);
  }

  setTheme(dark: boolean): void {
    const background = new THREE.Color(dark ? 0x14171c : 0xe9edf1);
    this.dark = dark;
    this.scene.background = this.seeThrough ? null : background;
    this.scene.fog = this.seeThrough ? null : new THREE.Fog(background, 1.2, 3);
    (this.floor.material as THREE.MeshStandardMaterial).color.set(dark ? 0x23282f : 0xd9dee3);
    this.scene.environmentIntensity = dark ? 0.35 : 0.55;
    this.sky.intensity = dark ? 0.8 : 1.5;
    for (const { mesh, description } of this.objects.values())
      if (description.isStatic) (mesh.material as THREE.MeshStandardMaterial).color.set(this.staticColour);
  }

  /** Removes background and floor for a headset that shows the room. */
  setSeeThrough(seeThrough: boolean): void {
    this.seeThrough = seeThrough;
    this.setTheme(this.dark);
    this.applyShown();
  }

  show(shown: Shown): void {
    this.updateSideDirection();
    this.shown = shown;
    this.applyShown();
    this.fit();
  }

  lookAtDefault(): void {
    this.framed = false;
    this.controls.target.set(0, 0.11, 0);
    this.camera.position.set(-0.38, 0.29, -0.33);
    this.controls.update();
    this.updateSideDirection();
  }

  lookFrom(position: [number, number, number], target: [number, number, number]): void {
    this.framed = true;
    this.controls.target.set(...target);
    this.camera.position.set(...position);
    this.controls.update();
    this.updateSideDirection();
  }

  /**
   * Moves the camera as dragging and the wheel do: to the right and up around its target by angles (rad). Its distance
   * is multiplied by `distance`.
   */
  orbit(right: number, up: number, distance: number): void {
    const { target } = this.controls;
    const seat = new THREE.Spherical().setFromVector3(this.camera.position.clone().sub(target));
    seat.set(seat.radius * distance, seat.phi - up, seat.theta + right).makeSafe();
    this.camera.position.setFromSpherical(seat).add(target);
  }

  /** Adds something that the topics do not describe. */
  add(object: THREE.Object3D): void {
    this.scene.add(object);
  }

  /** Removes all hands and objects. */
  clear(): void {
    for (const hand of this.hands.values()) this.removeHand(hand);
    this.hands.clear();
    for (const instance of [...this.objects.keys()]) this.removeObject(instance);
    for (const instance of [...this.softObjects.keys()]) this.removeSoftObject(instance);
  }

  private removeHand(hand: Hand): void {
    const groups = [
      ...Object.values(hand.bones),
      hand.contactArrows,
      hand.fingerArrows,
      hand.couplingArrows,
    ].map(({ group }) => group);
    this.scene.remove(hand.points, ...groups);
    for (const mesh of [
      hand.points,
      ...groups.flatMap(({ children }) => children as THREE.InstancedMesh<THREE.BufferGeometry, THREE.Material>[]),
    ]) {
      mesh.geometry.dispose();
      mesh.material.dispose();
      mesh.dispose();
    }
    if (!hand.skin) return;
    this.scene.remove(hand.skin.mesh);
    hand.skin.dispose();
  }

  private removeObject(instance: number): void {
    const object = this.objects.get(instance);
    if (!object) return;
    this.scene.remove(object.mesh);
    object.mesh.geometry.dispose();
    (object.mesh.material as THREE.Material).dispose();
    this.objects.delete(instance);
  }

  /** Hides what an ended stream showed, until its next frame. */
  silence(type: Type, instance: number): void {
    // The floor stays, because the table below which it lies is only not known now.
    if (type === Type.objects)
      for (const [of, object] of this.objects) if (worldOf(of) === instance) object.placed = false;
    const soft = type === Type.softNodes && this.softObjects.get(instance);
    if (soft) soft.nodes = null;
    const hand = this.hands.get(instance);
    if (hand) {
      if (type === Type.nodes) hand.nodes = null;
      if (type === Type.tracked) hand.bones.tracked.clear();
      if (type === Type.intermediate) hand.bones.intermediate.clear();
      if (type === Type.simulated) hand.bones.simulated.clear();
      if (type === Type.contacts) this.touch(instance, { contacts: [], fingers: [] });
      if (type === Type.wrench) this.couple(instance, false, []);
    }
    this.applyShown();
  }

  describeHand(instance: number, description: SkinDescription): void {
    const hand = this.hand(instance);
    if (hand.skin) {
      this.scene.remove(hand.skin.mesh);
      hand.skin.dispose();
    }
    hand.skin = new Skin(description, this.quality, null);
    this.scene.add(hand.skin.mesh);
    if (hand.nodes) this.deform(instance, hand.nodes);
    this.applyShown();
  }

  deform(instance: number, nodes: Nodes): void {
    const hand = this.hand(instance);
    hand.nodes = nodes;
    if (!hand.skin?.deform(nodes)) return;
    hand.skin.mesh.visible = this.shown.hand;
    if (this.colouring !== "skin") {
      hand.skin.measure(this.colouring);
      hand.skin.paint(this.colouring, this.full);
    }
    if (!this.framed) this.frame(hand.skin.mesh);
  }

  pose(instance: number, kind: SkeletonKind, skeleton: Skeleton): void {
    // Joints relative to a headset or desk have no world pose until `tracking` composes them.
    if (skeleton.frame === 0) this.hand(instance).bones[kind].pose(skeleton);
  }

  touch(instance: number, contacts: Omit<Contacts, "stamp">): void {
    const hand = this.hand(instance);
    hand.skin?.press(contacts.contacts);
    hand.contacts = contacts.contacts;
    hand.contactArrows.clear();
    hand.fingerArrows.clear();
    const matrix = new THREE.Matrix4();
    let n = 0;
    for (const contact of contacts.contacts) {
      hand.contactArrows.add(contact.point, contact.force, true);
      if (n < hand.points.instanceMatrix.count)
        hand.points.setMatrixAt(
          n++,
          matrix.makeScale(0.0011, 0.0011, 0.0011).setPosition(contact.point[0]!, contact.point[1]!, contact.point[2]!),
        );
    }
    hand.points.count = n;
    hand.points.instanceMatrix.needsUpdate = true;
    for (const finger of contacts.fingers)
      if (finger.count > 0) hand.fingerArrows.add(finger.centre, finger.force, false);
    hand.contactArrows.finish();
    hand.fingerArrows.finish();
  }

  couple(instance: number, valid: boolean, bones: Bone[]): void {
    const arrows = this.hand(instance).couplingArrows;
    arrows.clear();
    if (valid) for (const bone of bones) arrows.add(bone.intermediate, bone.couplingForce, false);
    arrows.finish();
  }

  describeObject(instance: number, description: ObjectDescription): void {
    const old = this.objects.get(instance);
    this.removeObject(instance);
    if (description.removed) return;
    const colour = description.isStatic ? this.staticColour : OBJECT_COLOURS[instance % OBJECT_COLOURS.length]!;
    const mesh = new THREE.Mesh(
      shapeOf(description),
      new THREE.MeshStandardMaterial({
        color: colour,
        roughness: description.isStatic ? 0.8 : 0.45,
        flatShading: description.shape === Shape.hull,
      }),
    );
    mesh.castShadow = description.shape !== Shape.plane;
    mesh.receiveShadow = true;
    if (old) {
      mesh.position.copy(old.mesh.position);
      mesh.quaternion.copy(old.mesh.quaternion);
    }
    this.objects.set(instance, { mesh, description, placed: old?.placed ?? false });
    this.scene.add(mesh);
    this.applyShown();
  }

  describeSoftObject(instance: number, description: SkinDescription): void {
    const nodes = this.softObjects.get(instance)?.nodes ?? null;
    this.removeSoftObject(instance);
    if (description.nodeCount === 0) return;
    const colour = OBJECT_COLOURS[(instance + 1) % OBJECT_COLOURS.length]!;
    const skin = new Skin(description, this.quality, colour);
    this.softObjects.set(instance, { skin, nodes: null });
    this.scene.add(skin.mesh);
    if (nodes) this.deformSoftObject(instance, nodes);
  }

  deformSoftObject(instance: number, nodes: Nodes): void {
    const object = this.softObjects.get(instance);
    if (!object?.skin.deform(nodes)) return;
    object.nodes = nodes;
    object.skin.mesh.visible = this.shown.objects;
    if (this.colouring === "skin") return;
    object.skin.measure(this.colouring);
    object.skin.paint(this.colouring, this.full);
  }

  private pressSoftObjects(): void {
    const contacts = [...this.hands.values()].flatMap((hand) => hand.contacts);
    for (const [instance, { skin }] of this.softObjects)
      skin.pressNearest(contacts.filter(({ object }) => object === FIRST_SOFT_OBJECT + instance));
  }

  private removeSoftObject(instance: number): void {
    const object = this.softObjects.get(instance);
    if (!object) return;
    this.scene.remove(object.skin.mesh);
    object.skin.dispose();
    this.softObjects.delete(instance);
  }

  /**
   * Places all objects of a world. An object that is not listed is hidden, even if nobody removed it. Static objects
   * are listed too. An object without a known place is not drawn.
   */
  place(world: number, states: ObjectState[]): void {
    let changed = false;
    const listed = new Set(states.map(({ id }) => objectInstance(world, id)));
    for (const [instance, object] of this.objects) {
      if (worldOf(instance) !== world || !object.placed || listed.has(instance)) continue;
      object.placed = false;
      changed = true;
    }
    for (const state of states) {
      const object = this.objects.get(objectInstance(world, state.id));
      if (!object) continue;
      object.mesh.position.fromArray(state.position);
      object.mesh.quaternion.fromArray(state.orientation);
      if (!object.placed) changed = true;
      object.placed = true;
      const material = object.mesh.material as THREE.MeshStandardMaterial;
      material.emissive.set(state.owned ? 0x1c1206 : 0x000000);
    }
    if (changed) {
      this.applyShown();
      this.layFloor();
    }
  }

  /** Colours all hands and flexible objects. The end of the map follows the large values in steps 1, 2, 5. */
  repaint(): void {
    if (this.colouring === "pressure") this.pressSoftObjects();
    const skins = [...this.hands.values(), ...this.softObjects.values()].flatMap(({ skin }) => skin ?? []);
    for (const skin of skins) skin.measure(this.colouring);
    const large = Math.max(0, ...skins.map((skin) => skin.large));
    const least = this.colouring === "pressure" ? 1000 : 0.05;
    const range = niceCeiling(Math.max(least, large));
    if (range > this.full || large < 0.3 * this.full) this.full = range;
    for (const skin of skins) skin.paint(this.colouring, this.full);
  }

  private get staticColour(): number {
    return this.dark ? STATIC_COLOURS.dark : STATIC_COLOURS.light;
  }

  get handCount(): number {
    return this.hands.size;
  }
  get hasStrain(): boolean {
    return [...this.hands.values(), ...this.softObjects.values()].some(({ skin }) => skin?.hasStrain);
  }

  /**
   * Widths (CSS pixels) along the canvas's edges that controls cover. The camera's target is put in the middle of the
   * rest.
   */
  setFree(left: number, top: number, right: number, bottom: number): void {
    this.free = { left, top, right, bottom };
    this.fit();
  }

  render(): void {
    if (this.renderer.xr.isPresenting) {
      this.renderer.render(this.scene, this.headset);
      return;
    }
    const width = this.canvas.clientWidth;
    const height = this.canvas.clientHeight;
    const ratio = Math.min(window.devicePixelRatio, this.quality === "high" ? 2 : 1) * this.resolution.scale;
    const size = this.renderer.getSize(new THREE.Vector2());
    if (size.x !== width || size.y !== height || this.renderer.getPixelRatio() !== ratio) {
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(width, height, false);
      this.fit();
    }
    this.controls.update();
    this.renderer.render(this.scene, this.camera);
  }

  // The frustum is that of the uncovered part. The picture continues around it.
  private fit(): void {
    const { left, top, right, bottom } = this.free;
    const { clientWidth, clientHeight } = this.canvas;
    const width = Math.max(1, clientWidth - left - right);
    const height = Math.max(1, clientHeight - top - bottom);
    this.camera.aspect = width / height;
    // A narrow screen shows the same width as a wide one.
    this.camera.fov =
      this.camera.aspect >= 1
        ? 38
        : 2 *
          THREE.MathUtils.radToDeg(
            Math.atan(Math.tan(THREE.MathUtils.degToRad(19)) / Math.sqrt(this.camera.aspect)),
          );
    // The view side by side needs more width.
    this.camera.zoom = this.shown.beside ? 0.55 * Math.min(1, Math.sqrt(this.camera.aspect)) : 1;
    this.camera.setViewOffset(width, height, -left, -top, clientWidth, clientHeight);
  }

  /** True while the browser has no graphics context for this page, for example after its graphics process ended. */
  get isBlind(): boolean {
    return this.renderer.getContext().isContextLost();
  }

  /** `elapsed`: ms between two pictures. */
  adapt(elapsed: number): void {
    if (!this.renderer.xr.isPresenting) this.resolution.adapt(elapsed);
  }

  private hand(instance: number): Hand {
    const known = this.hands.get(instance);
    if (known) {
      remember(this.hands, instance, known, MOST_HANDS);
      return known;
    }
    const hand: Hand = {
      skin: null,
      nodes: null,
      contacts: [],
      bones: {
        tracked: new Bones("tracked"),
        intermediate: new Bones("intermediate"),
        simulated: new Bones("simulated"),
      },
      // These arrows are a few pixels thick, and there may be hundreds of them. So each has few triangles.
      contactArrows: new Arrows(512, FORCE_COLOUR, 0.0006, 5),
      fingerArrows: new Arrows(6, FORCE_COLOUR, 0.0022, 14),
      points: new THREE.InstancedMesh(
        new THREE.IcosahedronGeometry(1),
        new THREE.MeshBasicMaterial({ color: 0xffd23f, depthTest: false, transparent: true }),
        512,
      ),
      couplingArrows: new Arrows(BONES, COUPLING_COLOUR, 0.0016, 12),
    };
    hand.points.count = 0;
    hand.points.frustumCulled = false;
    hand.points.renderOrder = 3;
    remember(this.hands, instance, hand, MOST_HANDS).forEach((old) => this.removeHand(old));
    this.scene.add(...Object.values(hand.bones).map((bones) => bones.group));
    this.scene.add(hand.contactArrows.group, hand.fingerArrows.group, hand.couplingArrows.group, hand.points);
    this.applyShown();
    return hand;
  }

  private lightRoom(): void {
    const generator = new THREE.PMREMGenerator(this.renderer);
    const room = new RoomEnvironment();
    this.light?.dispose();
    this.light = generator.fromScene(room, 0.04);
    this.scene.environment = this.light.texture;
    room.dispose();
    generator.dispose();
  }

  private updateSideDirection(): void {
    this.sideDirection.set(1, 0, 0).applyQuaternion(this.camera.quaternion).setY(0).normalize();
  }

  private applyShown(): void {
    for (const hand of this.hands.values()) {
      if (hand.skin) hand.skin.mesh.visible = this.shown.hand && hand.nodes !== null;
      for (const kind of ["tracked", "intermediate", "simulated"] as const) {
        hand.bones[kind].group.visible = this.shown[kind];
        // Side by side: the tracked skeleton to the left and the intermediate one to the right of the simulated hand.
        const away = kind === "simulated" || !this.shown.beside ? 0 : kind === "tracked" ? -0.17 : 0.17;
        hand.bones[kind].group.position.copy(this.sideDirection).multiplyScalar(away);
      }
      hand.contactArrows.group.visible = hand.fingerArrows.group.visible = hand.points.visible = this.shown.contacts;
      hand.couplingArrows.group.visible = this.shown.coupling;
    }
    for (const { mesh, placed } of this.objects.values()) mesh.visible = this.shown.objects && placed;
    for (const { skin, nodes } of this.softObjects.values()) skin.mesh.visible = this.shown.objects && nodes !== null;
    this.floor.visible = this.shown.floor && !this.seeThrough;
  }

  // The floor lies below all static objects.
  private layFloor(): void {
    const box = new THREE.Box3();
    for (const { mesh, description, placed } of this.objects.values())
      if (description.isStatic && description.shape !== Shape.plane && placed) box.expandByObject(mesh);
    this.floor.position.y = box.isEmpty() ? -0.001 : Math.min(-0.001, box.min.y - 0.0005);
  }

  private frame(mesh: THREE.Mesh): void {
    this.framed = true;
    const centre = new THREE.Box3().setFromObject(mesh, true).getCenter(new THREE.Vector3());
    if (centre.distanceTo(this.controls.target) < 0.25) {
      const move = centre.multiplyScalar(0.5).addScaledVector(this.controls.target, 0.5).sub(this.controls.target);
      this.controls.target.add(move);
      this.camera.position.add(move);
    } else {
      this.camera.position.add(centre.clone().sub(this.controls.target));
      this.controls.target.copy(centre);
    }
    this.sun.target.position.copy(this.controls.target);
    this.sun.position.copy(this.controls.target).add(new THREE.Vector3(-0.5, 1.05, 0.3));
  }
}

/** The smallest of 1, 2 and 5 times a power of ten that is at least `value`. */
function niceCeiling(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((step) => step * power).find((step) => step >= value * 0.9999)!;
}
