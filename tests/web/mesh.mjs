// Reads the generated mesh and casts rays at it, to check measured distances. It shares no code with what it tests.
import {readFileSync} from "node:fs";

const kSizes = {
  float: 4,
  double: 8,
  uchar: 1,
  int: 4,
  uint: 4
};
const kReaders = {
  float: "getFloat32",
  double: "getFloat64",
  uchar: "getUint8",
  int: "getInt32",
  uint: "getUint32"
};

/// Reads a little-endian PLY as `lumigrid sample` writes it. Returns {points: [[x, y, z]], triangles: [[i, j, k]]}.
export function readMesh(file) {
  const bytes = readFileSync(file);
  const end = bytes.indexOf("end_header\n") + "end_header\n".length;
  const lines = bytes.subarray(0, end).toString("latin1").split("\n");
  if (!lines.includes("format binary_little_endian 1.0")) throw new Error(`${file} is no little-endian PLY`);
  const count = (name) => Number(lines.find((line) => line.startsWith(`element ${name} `)).split(" ")[2]);
  const faceLine = lines.findIndex((line) => line.startsWith("element face"));
  const columns =
      lines.slice(0, faceLine).filter((line) => line.startsWith("property ")).map((line) => line.split(" ").slice(1));
  const [, , countType, indexType] = lines[faceLine + 1].split(" ");

  const data = new DataView(bytes.buffer, bytes.byteOffset + end, bytes.length - end);
  let at = 0;
  const next = (type) => {
    const value = data[kReaders[type]](at, true);
    at += kSizes[type];
    return value;
  };
  const points = Array.from({length: count("vertex")}, () => {
    const row = Object.fromEntries(columns.map(([type, name]) => [name, next(type)]));
    return [row.x, row.y, row.z];
  });
  const triangles =
      Array.from({length: count("face")}, () => Array.from({length: next(countType)}, () => next(indexType)));
  return {points, triangles};
}

const sub = (a, b) => a.map((x, i) => x - b[i]);
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((x) => x / Math.hypot(...a));

/// Returns the ray through the pixel (x, y) of a view as camera() returns it; perspective.
export function rayOf(view, x, y) {
  const [position, direction, up] = [view.slice(0, 3), unit(view.slice(3, 6)), view.slice(6, 9)];
  const [fov, , width, height] = view.slice(9);
  const right = unit(cross(direction, up));
  const above = cross(right, direction);
  const pixel = (2 * Math.tan(fov / 2)) / height;
  return {
    origin: position,
    direction: unit(direction.map((d, i) => d + pixel * ((x - width / 2) * right[i] - (y - height / 2) * above[i])))
  };
}

/// Returns the point where the ray first meets the mesh (Möller, Trumbore 1997); null where it does not.
export function meet({points, triangles}, {origin, direction}) {
  let nearest = Infinity;
  for (const [i, j, k] of triangles) {
    const [ab, ac] = [sub(points[j], points[i]), sub(points[k], points[i])];
    const p = cross(direction, ac);
    const det = dot(ab, p);
    if (det === 0) continue;
    const to = sub(origin, points[i]);
    const u = dot(to, p) / det;
    const q = cross(to, ab);
    const v = dot(direction, q) / det;
    const distance = dot(ac, q) / det;
    if (u >= 0 && v >= 0 && u + v <= 1 && distance > 0) nearest = Math.min(nearest, distance);
  }
  return nearest === Infinity ? null : origin.map((x, i) => x + nearest * direction[i]);
}
