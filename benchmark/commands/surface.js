// Draws SURFACE in place of the picture beside it, back to front, as seen along -z; the mouse turns it.
const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
const points = new Float32Array(bytes(SURFACE.points));
const faces = new Uint16Array(bytes(SURFACE.faces));
const colours = new Uint8Array(bytes(SURFACE.colours));
const image = document.querySelector("img");
const side = image.width;
const canvas = document.createElement("canvas");
const sharpness = window.devicePixelRatio || 1;
canvas.width = canvas.height = side * sharpness;
canvas.style.width = canvas.style.height = side + "px";
canvas.style.cursor = "grab";
image.replaceWith(canvas);
const pen = canvas.getContext("2d");
const turned = new Float32Array(points.length);
let turn = SURFACE.turn;
let radius = 0;
for (let k = 0; k < points.length; k += 3) {
  radius = Math.max(radius, Math.hypot(points[k], points[k + 1], points[k + 2]));
}

function draw() {
  for (let k = 0; k < points.length; k += 3) {
    for (let row = 0; row < 3; row++) {
      const axis = turn[row];
      turned[k + row] = axis[0] * points[k] + axis[1] * points[k + 1] + axis[2] * points[k + 2];
    }
  }
  const order = Array.from({ length: faces.length / 3 }, (_, face) => face);
  const depth = order.map((face) => {
    const [a, b, c] = [0, 1, 2].map((corner) => turned[3 * faces[3 * face + corner] + 2]);
    return a + b + c;
  });
  order.sort((one, other) => depth[one] - depth[other]);
  const scale = (0.47 * canvas.width) / radius;
  const middle = canvas.width / 2;
  pen.clearRect(0, 0, canvas.width, canvas.height);
  for (const face of order) {
    const [a, b, c] = [0, 1, 2].map((corner) => 3 * faces[3 * face + corner]);
    const u = [0, 1, 2].map((k) => turned[b + k] - turned[a + k]);
    const v = [0, 1, 2].map((k) => turned[c + k] - turned[a + k]);
    const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const length = Math.hypot(...normal) || 1;
    const light = 0.45 + 0.6 * Math.abs((-0.4 * normal[0] + 0.6 * normal[1] + 0.7 * normal[2]) / length);
    const colour = [0, 1, 2].map((k) => Math.min(255, light * colours[a + k]) | 0);
    pen.fillStyle = pen.strokeStyle = `rgb(${colour.join(",")})`;
    pen.beginPath();
    for (const corner of [a, b, c]) {
      pen.lineTo(middle + scale * turned[corner], middle - scale * turned[corner + 1]);
    }
    pen.closePath();
    pen.fill();
    pen.stroke();
  }
}

function rotate(right, down) {
  const [cx, sx, cy, sy] = [Math.cos(down), Math.sin(down), Math.cos(right), Math.sin(right)];
  const by = [
    [cy, 0, sy],
    [sx * sy, cx, -sx * cy],
    [-cx * sy, sx, cx * cy],
  ];
  turn = by.map((row) => [0, 1, 2].map((k) => row[0] * turn[0][k] + row[1] * turn[1][k] + row[2] * turn[2][k]));
}

canvas.addEventListener("pointermove", (event) => {
  if (event.buttons) {
    rotate(event.movementX / 100, event.movementY / 100);
    requestAnimationFrame(draw);
  }
});
draw();
