// The geometry of an object of the world, from its description.
import * as THREE from "three";
import { ConvexGeometry } from "three/addons/geometries/ConvexGeometry.js";
import { creasedNormals } from "./normals";
import { type ObjectDescription, Shape } from "./protocol";

const CREASE = 0.6; // rad; edges of object files that bend more are sharp

export function shapeOf({ shape, size, vertices, triangles }: ObjectDescription): THREE.BufferGeometry {
  const [x, y, z] = [size[0]!, size[1]!, size[2]!];
  switch (shape) {
    case Shape.sphere:
      return new THREE.SphereGeometry(x, 48, 32);
    case Shape.box:
      return new THREE.BoxGeometry(2 * x, 2 * y, 2 * z);
    case Shape.capsule:
      return new THREE.CapsuleGeometry(x, 2 * y, 16, 40);
    case Shape.cylinder:
      return new THREE.CylinderGeometry(x, x, 2 * y, 56);
    case Shape.hull: {
      const points = [];
      for (let i = 0; i + 2 < vertices.length; i += 3)
        points.push(new THREE.Vector3(vertices[i]!, vertices[i + 1]!, vertices[i + 2]!));
      return new ConvexGeometry(points);
    }
    case Shape.file: {
      const geometry = new THREE.BufferGeometry();
      const { positions, normals } = creasedNormals(vertices, triangles, CREASE);
      geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
      geometry.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
      return geometry;
    }
    default:
      return new THREE.PlaneGeometry(4, 4).rotateX(-Math.PI / 2);
  }
}
