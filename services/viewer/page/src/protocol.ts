// The binary frames of softhand-viewer. The layouts are those of ../../frames.hpp and docs/viewer.md.
// A frame that does not match is refused with a reason.

const MAGIC = 0x46564853;
const VERSION = 3;
const HEADER = 16;
export const JOINTS = 26;
export const BONES = 21;

export enum Type {
  handDescription = 1,
  nodes,
  tracked,
  intermediate,
  simulated,
  contacts,
  objects,
  objectDescription,
  wrench,
  status,
  reply,
  gateway,
  choices,
  softDescription,
  softNodes,
  prompt,
  show = 32,
  message = 33,
}

export interface Frame {
  type: Type;
  instance: number;
  payload: DataView;
}

export interface Stamp {
  sample: number; // s, monotonic clock of the host
  published: number;
  sequence: number;
}

/** Splits a message into frames. Throws if a header or a length is wrong. */
export function split(message: ArrayBuffer): Frame[] {
  const view = new DataView(message);
  const frames: Frame[] = [];
  for (let at = 0; at < view.byteLength; ) {
    if (at + HEADER > view.byteLength) throw new Error("short header");
    if (view.getUint32(at, true) !== MAGIC) throw new Error("not a softhand frame");
    const version = view.getUint16(at + 4, true);
    if (version !== VERSION) throw new Error(`frame version ${version}, expected ${VERSION}`);
    const length = view.getUint32(at + 8, true);
    if (at + HEADER + length > view.byteLength) throw new Error("short frame");
    frames.push({
      type: view.getUint16(at + 6, true),
      instance: view.getUint32(at + 12, true),
      payload: new DataView(message, at + HEADER, length),
    });
    at += HEADER + length;
  }
  return frames;
}

/** Reads a payload from front to back. DataView throws beyond its end. */
class Reader {
  at = 0;
  constructor(readonly view: DataView) {}
  u32(): number {
    this.at += 4;
    return this.view.getUint32(this.at - 4, true);
  }
  u64(): bigint {
    this.at += 8;
    return this.view.getBigUint64(this.at - 8, true);
  }
  f32(): number {
    this.at += 4;
    return finite(this.view.getFloat32(this.at - 4, true));
  }
  f64(): number {
    this.at += 8;
    return finite(this.view.getFloat64(this.at - 8, true));
  }
  f32s(count: number): Float32Array {
    const values = new Float32Array(this.bytes(4 * count));
    for (const value of values) finite(value);
    return values;
  }
  u16s(count: number): Uint16Array {
    return new Uint16Array(this.bytes(2 * count));
  }
  u32s(count: number): Uint32Array {
    return new Uint32Array(this.bytes(4 * count));
  }
  text(length: number): string {
    const text = new TextDecoder().decode(this.bytes(length));
    const end = text.indexOf("\0");
    return end < 0 ? text : text.slice(0, end);
  }
  stamp(): Stamp {
    return { sample: this.f64(), published: this.f64(), sequence: this.f64() };
  }
  bytes(count: number): ArrayBuffer {
    if (this.at + count > this.view.byteLength) throw new RangeError("short frame");
    const from = this.view.byteOffset + this.at;
    this.at += count;
    return this.view.buffer.slice(from, from + count) as ArrayBuffer;
  }
}

function finite(value: number): number {
  if (!Number.isFinite(value)) throw new Error("a number is not finite");
  return value;
}

/** A surface whose vertices follow nodes: the skin of a hand, or a flexible object. */
export interface SkinDescription {
  nodeCount: number; // 0: the flexible object was removed
  restNodes: Float32Array; // 3 N values, or empty
  weights: Float32Array; // 4 V values
  nodes: Uint16Array; // 4 V values
  triangles: Uint16Array; // 3 T values
}
export function skinDescription(payload: DataView): SkinDescription {
  const r = new Reader(payload);
  const nodeCount = r.u32();
  const vertices = r.u32();
  const triangles = r.u32();
  const rest = r.u32();
  const description = {
    nodeCount,
    restNodes: r.f32s(3 * rest),
    weights: r.f32s(4 * vertices),
    nodes: r.u16s(4 * vertices),
    triangles: r.u16s(3 * triangles),
  };
  if (description.nodes.some((node) => node >= nodeCount) || description.triangles.some((vertex) => vertex >= vertices))
    throw new Error("an index is out of range");
  return description;
}

export interface Nodes {
  stamp: Stamp;
  origin: Float32Array; // wrist, or centre of mass
  positions: Float32Array; // 3 N values, relative to the origin
}
export function nodes(payload: DataView): Nodes {
  const r = new Reader(payload);
  const stamp = r.stamp();
  const origin = r.f32s(3);
  const count = r.u32();
  const quantised = r.u32() === 1;
  const step = r.f32();
  if (!quantised) return { stamp, origin, positions: r.f32s(3 * count) };
  const raw = new Int16Array(r.bytes(6 * count));
  const positions = new Float32Array(raw.length);
  for (let i = 0; i < raw.length; ++i) positions[i] = raw[i]! * step;
  return { stamp, origin, positions };
}

export interface Joint {
  position: Float32Array;
  orientation: Float32Array; // xyzw
  radius: number;
  valid: boolean;
}
export interface Skeleton {
  stamp: Stamp;
  source: number;
  frame: number; // 0 = world, otherwise relative to a device
  joints: Joint[];
}
export function skeleton(payload: DataView): Skeleton {
  const r = new Reader(payload);
  const stamp = r.stamp();
  const source = r.u32();
  const frame = r.u32();
  const joints: Joint[] = [];
  for (let j = 0; j < JOINTS; ++j)
    joints.push({ position: r.f32s(3), orientation: r.f32s(4), radius: r.f32(), valid: (r.u32() & 1) !== 0 });
  return { stamp, source, frame, joints };
}

/** Ids of flexible objects begin here. Their frames have the instance id - FIRST_SOFT_OBJECT. */
export const FIRST_SOFT_OBJECT = 65536;
/** The instance of an object's description. Objects of two worlds may have the same id. */
export const objectInstance = (world: number, id: number): number => world * FIRST_SOFT_OBJECT + id;
export const worldOf = (instance: number): number => Math.floor(instance / FIRST_SOFT_OBJECT);
export const FINGERS = ["thumb", "index", "middle", "ring", "little", "palm"];
export interface Contact {
  node: number;
  object: number;
  point: Float32Array;
  force: Float32Array;
  penetration: number;
  area: number;
  sticking: boolean;
}
export interface Contacts {
  stamp: Stamp;
  fingers: { force: Float32Array; centre: Float32Array; count: number }[];
  contacts: Contact[];
}
export function contacts(payload: DataView): Contacts {
  const r = new Reader(payload);
  const stamp = r.stamp();
  const fingers = FINGERS.map(() => {
    const force = r.f32s(3);
    const centre = r.f32s(3);
    r.at += 24; // normal, area, slip speed, object
    return { force, centre, count: r.u32() };
  });
  const count = r.u32();
  r.at += 4;
  const list: Contact[] = [];
  for (let i = 0; i < count; ++i) {
    const node = r.u32();
    const object = r.u32();
    r.at += 4; // finger
    const sticking = (r.u32() & 1) !== 0;
    const point = r.f32s(3);
    r.at += 12; // normal
    const force = r.f32s(3);
    const penetration = r.f32();
    const area = r.f32();
    r.at += 4; // slip speed
    list.push({ node, object, point, force, penetration, area, sticking });
  }
  return { stamp, fingers, contacts: list };
}

export interface ObjectState {
  id: number;
  owned: boolean;
  position: Float32Array;
  orientation: Float32Array;
}
export function objects(payload: DataView): { stamp: Stamp; objects: ObjectState[] } {
  const r = new Reader(payload);
  const stamp = r.stamp();
  const count = r.u32();
  r.at += 4;
  const list: ObjectState[] = [];
  for (let i = 0; i < count; ++i) {
    const id = r.u32();
    const owned = r.u32() !== 0;
    r.at += 4; // owner
    const position = r.f32s(3);
    const orientation = r.f32s(4);
    r.at += 12; // velocity
    list.push({ id, owned, position, orientation });
  }
  return { stamp, objects: list };
}

export enum Shape {
  sphere,
  box,
  capsule,
  cylinder,
  plane,
  hull,
  file,
}
export interface ObjectDescription {
  isStatic: boolean;
  removed: boolean;
  shape: Shape;
  mass: number;
  size: Float32Array;
  name: string;
  vertices: Float32Array;
  triangles: Uint32Array; // of a link of an object file: indices of vertices
}
export function objectDescription(payload: DataView): ObjectDescription {
  const r = new Reader(payload);
  const isStatic = r.u32() !== 0;
  const removed = r.u32() !== 0;
  const shape: Shape = r.u32();
  const count = r.u32();
  const mass = r.f32();
  r.at += 4; // friction
  const [size, name, vertices] = [r.f32s(3), r.text(64), r.f32s(3 * count)];
  const triangles = shape === Shape.file && !removed ? r.u32s(3 * r.u32()) : new Uint32Array();
  if (triangles.some((vertex) => vertex >= count)) throw new RangeError("a triangle of an object has a wrong vertex");
  return { isStatic, removed, shape, mass, size, name, vertices, triangles };
}

export interface Bone {
  simulated: Float32Array;
  intermediate: Float32Array;
  couplingForce: Float32Array;
}
export function wrench(payload: DataView): { stamp: Stamp; valid: boolean; bones: Bone[] } {
  const r = new Reader(payload);
  const stamp = r.stamp();
  const valid = r.u32() !== 0;
  const count = r.u32();
  const bones: Bone[] = [];
  for (let i = 0; i < count; ++i) {
    bones.push({ simulated: r.f32s(3), intermediate: r.f32s(3), couplingForce: r.f32s(3) });
    r.at += 24; // coupling torque, contact force
  }
  return { stamp, valid, bones };
}

export interface Named {
  name: string;
  value: number;
}
/** A status of a loop. Its fields have the names, meanings and units of idl/status.idl. */
export interface Status {
  stamp: Stamp;
  module: string;
  numbers: Record<string, number>;
  texts: Record<string, string>;
  lists: Record<string, Named[]>;
}
export function status(payload: DataView): Status {
  const r = new Reader(payload);
  const named = <T>(value: () => T): { name: string; value: T }[] => {
    const count = r.u32();
    r.at += 4;
    return Array.from({ length: count }, () => ({ name: r.text(32), value: value() }));
  };
  const record = <T>(value: () => T): Record<string, T> =>
    Object.fromEntries(named(value).map(({ name, value }) => [name, value]));
  return {
    stamp: r.stamp(),
    module: r.text(64),
    numbers: record(() => r.f64()),
    texts: record(() => r.text(128)),
    lists: record(() => named(() => r.f64())),
  };
}

/** What a message to a rig can choose. */
export interface Choice {
  what: string; // key of the message
  choice: string; // its value
  running: boolean;
}
export function choices(payload: DataView): { module: string; choices: Choice[] } {
  const r = new Reader(payload);
  const module = r.text(64);
  const count = r.u32();
  r.at += 4;
  const choice = (): Choice => {
    const read = { what: r.text(64), choice: r.text(64), running: r.u32() !== 0 };
    r.at += 4;
    return read;
  };
  return { module, choices: Array.from({ length: count }, choice) };
}

/** What a person is asked to do. An empty text: nothing any more. */
export interface Prompt {
  seconds: number;
  text: string;
}
export function prompt(payload: DataView): Prompt {
  const r = new Reader(payload);
  return { seconds: r.f32(), text: r.text(64) };
}

export interface Reply {
  id: bigint;
  result: number; // 0 ignored, 1 applied, 2 refused
  module: string;
  text: string;
}
export function reply(payload: DataView): Reply {
  const r = new Reader(payload);
  const id = r.u64();
  const result = r.u32();
  r.at += 4;
  return { id, result, module: r.text(64), text: r.text(128) };
}

export interface GatewayState {
  clock: number;
  epoch: bigint; // differs for each start of a gateway
  pages: number;
  rate: number;
  bytes: number;
  frames: number;
  passedOver: number;
  refused: number;
}
export function gateway(payload: DataView): GatewayState {
  const r = new Reader(payload);
  const state = {
    clock: r.f64(),
    epoch: r.u64(),
    pages: r.u32(),
    rate: r.u32(),
    bytes: r.f64(),
    frames: r.f64(),
    passedOver: r.f64(),
    refused: r.f64(),
  };
  while (r.at < payload.byteLength) state.refused += r.f64();
  return state;
}

function build(type: Type, payloadBytes: number): { bytes: ArrayBuffer; payload: DataView } {
  const bytes = new ArrayBuffer(HEADER + payloadBytes);
  const header = new DataView(bytes);
  header.setUint32(0, MAGIC, true);
  header.setUint16(4, VERSION, true);
  header.setUint16(6, type, true);
  header.setUint32(8, payloadBytes, true);
  return { bytes, payload: new DataView(bytes, HEADER) };
}

/** Requests these types, each at most `rate` times a second (0 = `viewer.rate_hz`). */
export function show(types: Type[], rate: number): ArrayBuffer {
  const { bytes, payload } = build(Type.show, 8);
  payload.setUint32(
    0,
    types.reduce((set, type) => set | (1 << type), 0),
    true,
  );
  payload.setFloat32(4, rate, true);
  return bytes;
}

/** A message to a module, or to all modules with "*". Texts are truncated to 63 bytes. */
export function message(id: bigint, module: string, key: string, value: string): ArrayBuffer {
  const { bytes, payload } = build(Type.message, 8 + 3 * 64);
  payload.setBigUint64(0, id, true);
  [module, key, value].forEach((text, field) =>
    new TextEncoder()
      .encode(text)
      .slice(0, 63)
      .forEach((byte, i) => payload.setUint8(8 + 64 * field + i, byte)),
  );
  return bytes;
}
