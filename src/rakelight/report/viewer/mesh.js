// Triangles of a depth map: every step-th pixel, as few as the budget asks for.  The outline is
// cut by the mask in the texture, so the mesh goes on a little beyond the object.

function decimate(depth, camera, { most_triangles, steepest }) {
  let inside = 0;
  for (const z of depth) if (!Number.isNaN(z)) inside++;
  let step = Math.max(1, Math.floor(Math.sqrt((2 * inside) / most_triangles)));
  for (; ; step++) {
    const mesh = gridMesh(depth, camera, step, steepest);
    if (mesh.indices.length <= 3 * most_triangles) return mesh;
  }
}

function gridMesh(depth, { width, height, fx, fy }, step, steepest) {
  const lines = (size) => {
    const at = [];
    for (let i = 0; i < size - 1; i += step) at.push(i);
    return at.concat(size - 1);
  };
  const columns = lines(width), rows = lines(height);
  const count = columns.length * rows.length;
  const pixels = new Uint16Array(2 * count), z = new Float32Array(count);
  rows.forEach((row, j) => columns.forEach((column, i) => {
    const k = j * columns.length + i;
    pixels[2 * k] = column;
    pixels[2 * k + 1] = row;
    z[k] = depthAround(depth, width, height, column, row, step);
  }));

  const joined = (a, b, far) => Math.abs(z[a] - z[b]) <= steepest * far * Math.min(z[a], z[b]);
  const indices = [];
  const right = step / fx, down = step / fy, across = Math.hypot(right, down);
  for (let j = 0; j < rows.length - 1; j++) {
    for (let i = 0; i < columns.length - 1; i++) {
      const a = j * columns.length + i, b = a + 1, c = a + columns.length, d = c + 1;
      if (!shows(depth, width, columns[i], columns[i + 1], rows[j], rows[j + 1])) continue;
      if (Math.abs(z[a] - z[d]) <= Math.abs(z[b] - z[c])) {
        if (!joined(a, d, across)) continue;
        if (joined(a, c, down) && joined(c, d, right)) indices.push(a, c, d);
        if (joined(a, b, right) && joined(b, d, down)) indices.push(a, d, b);
      } else if (joined(b, c, across)) {
        if (joined(a, c, down) && joined(a, b, right)) indices.push(a, c, b);
        if (joined(b, d, down) && joined(c, d, right)) indices.push(b, c, d);
      }
    }
  }
  return { pixels, z, indices: new Uint32Array(indices), step };
}

// The pixel's own depth, or the mean of its neighbourhood's where it lies outside the object.
function depthAround(depth, width, height, column, row, reach) {
  const own = depth[row * width + column];
  if (!Number.isNaN(own)) return own;
  let sum = 0, count = 0;
  for (let y = Math.max(0, row - reach); y <= Math.min(height - 1, row + reach); y++) {
    for (let x = Math.max(0, column - reach); x <= Math.min(width - 1, column + reach); x++) {
      const z = depth[y * width + x];
      if (!Number.isNaN(z)) { sum += z; count++; }
    }
  }
  return count ? sum / count : NaN;
}

function shows(depth, width, left, right, top, bottom) {
  for (let y = top; y <= bottom; y++) {
    for (let x = left; x <= right; x++) if (!Number.isNaN(depth[y * width + x])) return true;
  }
  return false;
}
