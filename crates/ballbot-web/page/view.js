// The scene in 3D: floor, robots, target, pushes. x forward, y left, z up, m.

import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const LIGHT = { back: 0xf6f8fa, floor: 0xf0f2f5, lines: 0xacb4be, ghost: 0x7a8492 };
const DARK = { back: 0x1f242b, floor: 0x262c34, lines: 0x4e5763, ghost: 0x9aa4b2 };
const GHOST_OPACITY = 0.35;

/** Edge of the squares on the ground, m. */
const SQUARE = 0.5;

/** Nodes along an edge of the patch of uneven ground. */
const PATCH = 321;

const OBSTACLE = new THREE.MeshStandardMaterial({ color: 0xc58a5c, roughness: 0.8 });

/** An obstacle from the ground up. */
function obstacleMesh([x, y, top, angle, length, width, radius]) {
  const geometry =
    radius > 0
      ? new THREE.CylinderGeometry(radius, radius, top, 24).rotateX(0.5 * Math.PI)
      : new THREE.BoxGeometry(length, width, top);
  const mesh = new THREE.Mesh(geometry.rotateZ(angle), OBSTACLE);
  mesh.position.set(x, y, 0.5 * top);
  mesh.castShadow = mesh.receiveShadow = true;
  return mesh;
}

export class View {
  constructor(parent, looks) {
    Object.assign(this, { parent, looks, robots: [], ghosts: [], arrows: [] });
    this.renderer = new THREE.WebGLRenderer({ antialias: true });
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = THREE.PCFSoftShadowMap;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    parent.append(this.renderer.domElement);
    this.world = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(45, 1, 0.02, 200);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.enablePan = false;
    this.controls.maxPolarAngle = 0.49 * Math.PI;
    this.controls.mouseButtons.RIGHT = THREE.MOUSE.ROTATE;
    this.sun = new THREE.DirectionalLight(0xffffff, 2.2);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(2048, 2048);
    this.sun.shadow.bias = -0.0005;
    this.world.add(this.sun, this.sun.target, new THREE.HemisphereLight(0xffffff, 0x8a8f98, 1.6));
    this.floor = new THREE.Mesh(plane(200, 1), new THREE.MeshStandardMaterial({ roughness: 1 }));
    this.floor.receiveShadow = true;
    this.world.add(this.floor);
    this.target = new THREE.Mesh(
      new THREE.RingGeometry(0.8, 1, 48),
      new THREE.MeshBasicMaterial({ color: 0x6d3bbf, depthWrite: false }),
    );
    this.world.add(this.target);
    this.ray = new THREE.Raycaster();
    this.dark = matchMedia("(prefers-color-scheme: dark)");
    this.dark.addEventListener("change", () => this.paint());
    this.paint();
    new ResizeObserver(() => this.resize()).observe(parent);
    this.resize();
  }

  paint() {
    const colors = this.dark.matches ? DARK : LIGHT;
    this.world.background = new THREE.Color(colors.back);
    this.world.fog = new THREE.Fog(colors.back, 8, 40);
    this.squares?.dispose();
    this.squares = squares(colors);
    this.floor.material.map = this.squares;
    this.floor.material.needsUpdate = true;
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.parent;
    if (!width || !height) return;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
  }

  /** Shows other robots; `size` is the radius of the ball, `height` of a robot, m. */
  show(robot, count, ghosts, size) {
    for (const old of [...this.robots, ...this.ghosts]) old.removeFromParent();
    this.dropPatch();
    const look = this.looks[robot];
    this.robots = Array.from({ length: count }, () => new RobotMesh(look, false));
    this.ghosts = Array.from({ length: ghosts }, () => new RobotMesh(look, true));
    this.world.add(...this.robots, ...this.ghosts);
    this.size = size;
    this.height = new THREE.Box3().setFromObject(this.robots[0]).max.z + size;
    this.target.scale.setScalar(1.1 * size);
    const reach = Math.max(1.2 * this.height, 4 * size * Math.sqrt(count));
    Object.assign(this.sun.shadow.camera, { left: -reach, right: reach, top: reach, bottom: -reach, far: 12 * reach });
    this.sun.shadow.camera.updateProjectionMatrix();
    this.reach = reach;
  }

  /** Looks at the first robot from its right, as far as the robots need. */
  frame() {
    const distance = Math.max(2.6 * this.height, 9 * this.size * Math.sqrt(this.robots.length));
    this.controls.target.set(0, 0, 0.5 * this.height);
    this.camera.position.set(0.75 * distance, -0.65 * distance, 0.5 * this.height + 0.45 * distance);
    this.last = undefined;
  }

  /** Shows uneven ground about the first robot, or the level floor. */
  showGround(scene, isUneven) {
    this.floor.visible = !isUneven;
    if (!isUneven) return this.dropPatch();
    const [x, y] = [...scene.part(0, "ball_position")].map(snapped);
    const half = Math.ceil(Math.max(8, 0.8 * this.reach));
    if (this.patch && Math.hypot(x - this.patch.position.x, y - this.patch.position.y) < 0.3 * half) return;
    this.dropPatch();
    const geometry = plane(2 * half, PATCH - 1);
    const heights = scene.heights(x, y, half, PATCH);
    const places = geometry.attributes.position;
    for (let i = 0; i < places.count; i++) {
      // Rows of the plane run from +y to −y.
      const row = PATCH - 1 - Math.floor(i / PATCH);
      places.setZ(i, heights[row * PATCH + (i % PATCH)]);
    }
    geometry.computeVertexNormals();
    this.patch = new THREE.Mesh(geometry, this.floor.material);
    this.patch.position.set(x, y, 0);
    this.patch.receiveShadow = true;
    this.obstacles = new THREE.Group();
    this.obstacles.add(...scene.obstacles().map(obstacleMesh));
    this.world.add(this.patch, this.obstacles);
  }

  dropPatch() {
    this.patch?.removeFromParent();
    this.patch?.geometry.dispose();
    this.patch = undefined;
    for (const { geometry } of this.obstacles?.children ?? []) geometry.dispose();
    this.obstacles?.removeFromParent();
    this.obstacles = undefined;
  }

  /** Where the camera is from the ball. */
  get place() {
    const { x, y } = this.last ?? { x: 0, y: 0 };
    const [cameraX, cameraY, z] = this.camera.position.toArray();
    return [cameraX - x, cameraY - y, z];
  }

  /** Moves the robots to the rows of scenes. */
  update(scene, ghost, follow) {
    this.robots.forEach((robot, i) => robot.update(scene, i));
    this.ghosts.forEach((robot, i) => robot.update(ghost, i));
    const [x, y] = scene.part(0, "ball_position");
    const [targetX, targetY] = scene.part(0, "setpoint");
    this.target.position.set(targetX, targetY, this.patch ? 0.01 + scene.part(0, "ball_position")[2] - this.size : 0.002);
    this.target.visible = Math.hypot(targetX - x, targetY - y) > 0.05 * this.size;
    const moved = new THREE.Vector3(x, y, 0).sub(this.last ?? new THREE.Vector3());
    this.last = new THREE.Vector3(x, y, 0);
    this.controls.target.add(moved);
    this.camera.position.add(moved);
    if (follow) {
      const heading = this.robots[0].heading();
      const away = this.camera.position.clone().sub(this.controls.target);
      const flat = Math.hypot(away.x, away.y);
      const wanted = Math.atan2(-heading.y, -heading.x);
      const now = Math.atan2(away.y, away.x);
      const turn = now + 0.08 * Math.atan2(Math.sin(wanted - now), Math.cos(wanted - now));
      this.camera.position.x = this.controls.target.x + flat * Math.cos(turn);
      this.camera.position.y = this.controls.target.y + flat * Math.sin(turn);
    }
    this.sun.target.position.set(x, y, 0);
    this.sun.position.set(x + 1.2 * this.reach, y - 1.5 * this.reach, 4 * this.reach);
    this.floor.position.set(snapped(x), snapped(y), 0);
    const now = performance.now();
    this.arrows = this.arrows.filter((arrow) => (arrow.userData.until > now ? true : (arrow.removeFromParent(), arrow.dispose(), false)));
    this.controls.update();
    this.renderer.render(this.world, this.camera);
  }

  /** An arrow for a push of the first robot. */
  showPush(x, y, from) {
    const direction = new THREE.Vector3(x, y, 0).normalize();
    const length = 0.6 * this.height;
    const arrow = new THREE.ArrowHelper(
      direction, new THREE.Vector3(...from).addScaledVector(direction, -length), length, 0xd33a2c, 0.2 * length, 0.1 * length,
    );
    arrow.userData.until = performance.now() + 700;
    this.arrows.push(arrow);
    this.world.add(arrow);
  }

  aim(event) {
    const box = this.renderer.domElement.getBoundingClientRect();
    const point = new THREE.Vector2(
      (2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height,
    );
    this.ray.setFromCamera(point, this.camera);
    return this.ray.ray;
  }

  /** The robot under the pointer, with the point that is hit, or null. */
  robotAt(event) {
    this.aim(event);
    const [hit] = this.ray.intersectObjects(this.robots, true);
    if (!hit) return null;
    let node = hit.object;
    while (!(node instanceof RobotMesh)) node = node.parent;
    return { index: this.robots.indexOf(node), point: hit.point };
  }

  /** The point of the floor under the pointer, or null. */
  floorAt(event) {
    return this.aim(event).intersectPlane(new THREE.Plane(new THREE.Vector3(0, 0, 1), 0), new THREE.Vector3());
  }

  /** Where the pointer is in the plane through a point that faces the camera. */
  beside(event, point) {
    const facing = this.camera.getWorldDirection(new THREE.Vector3()).negate();
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(facing, new THREE.Vector3(...point));
    return this.aim(event).intersectPlane(plane, new THREE.Vector3());
  }
}

/** Ball, body and wheels of a robot. */
class RobotMesh extends THREE.Group {
  constructor(look, isGhost) {
    super();
    const node = (pieces, smooth) => {
      const group = new THREE.Group();
      for (const piece of pieces) group.add(mesh(piece, smooth, isGhost));
      return group;
    };
    this.ball = node(look.ball, true);
    this.body = node(look.body, false);
    this.wheels = look.mounts.map((mount) => {
      const place = new THREE.Group();
      place.matrixAutoUpdate = false;
      place.matrix.fromArray(mount).transpose();
      const wheel = node(look.wheel, false);
      place.add(wheel);
      this.body.add(place);
      return wheel;
    });
    this.axle = new THREE.Vector3(...look.axle);
    this.add(this.ball, this.body);
  }

  update(scene, i) {
    const place = (node, position, quaternion) => {
      const [w, x, y, z] = scene.part(i, quaternion);
      node.position.fromArray(scene.part(i, position));
      node.quaternion.set(x, y, z, w);
    };
    place(this.ball, "ball_position", "ball_quaternion");
    place(this.body, "body_position", "body_quaternion");
    const angles = scene.part(i, "wheel_angles");
    this.wheels.forEach((wheel, k) => wheel.quaternion.setFromAxisAngle(this.axle, angles[k]));
  }

  /** The x axis of the body. */
  heading() {
    return new THREE.Vector3(1, 0, 0).applyQuaternion(this.body.quaternion);
  }
}

/** The nearest corner of the squares on the ground. */
const snapped = (coordinate) => Math.round(coordinate / SQUARE) * SQUARE;

/** A square in the plane of x and y with as many texture coordinates as it has squares of the ground. */
function plane(size, cells) {
  const geometry = new THREE.PlaneGeometry(size, size, cells, cells);
  const places = geometry.attributes.uv;
  for (let i = 0; i < places.count; i++) places.setXY(i, (places.getX(i) * size) / SQUARE, (places.getY(i) * size) / SQUARE);
  return geometry;
}

/** The texture of a square of the ground: its lower and left edge. */
function squares({ floor, lines }) {
  const canvas = Object.assign(document.createElement("canvas"), { width: 256, height: 256 });
  const context = canvas.getContext("2d");
  const style = (color) => `#${color.toString(16).padStart(6, "0")}`;
  context.fillStyle = style(floor);
  context.fillRect(0, 0, 256, 256);
  context.fillStyle = style(lines);
  context.fillRect(0, 252, 256, 4);
  context.fillRect(0, 0, 4, 256);
  const texture = new THREE.CanvasTexture(canvas);
  texture.wrapS = texture.wrapT = THREE.RepeatWrapping;
  texture.anisotropy = 8;
  texture.colorSpace = THREE.SRGBColorSpace;
  return texture;
}

const numbers = (text, Kind) => new Kind(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);

/** Triangles of one color; made once for all robots. */
function mesh(piece, smooth, isGhost) {
  if (!piece.geometry) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(numbers(piece.vertices, Float32Array), 3));
    geometry.setIndex(new THREE.BufferAttribute(numbers(piece.faces, Uint32Array), 1));
    if (smooth) geometry.computeVertexNormals();
    piece.geometry = geometry;
  }
  const kind = isGhost ? "ghost" : "solid";
  if (!piece[kind]) {
    const color = new THREE.Color(`rgb(${piece.color})`);
    piece[kind] = new THREE.MeshStandardMaterial({ color, roughness: 0.6, metalness: 0.1, flatShading: !smooth });
    if (isGhost) Object.assign(piece[kind], { transparent: true, opacity: GHOST_OPACITY, depthWrite: false });
  }
  const out = new THREE.Mesh(piece.geometry, piece[kind]);
  out.castShadow = !isGhost;
  out.receiveShadow = !isGhost;
  return out;
}
