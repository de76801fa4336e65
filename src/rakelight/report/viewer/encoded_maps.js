// The maps of the page: base64, deflated, each value minus what its left, upper and upper left
// neighbours predict.  Depth is uint16 (0 = none), normals are octahedral in 12 bits.

class TooOld extends Error {}

async function unpackMap({ name, bits, width, height }) {
  const text = atob(document.getElementById("map-" + name).textContent);
  const packed = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) packed[i] = text.charCodeAt(i);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const count = width * height;
  const values = bits === 8 ? bytes : new Uint16Array(count);
  if (bits === 16) for (let i = 0; i < count; i++) values[i] = bytes[i] | (bytes[count + i] << 8);
  for (let i = width; i < count; i++) values[i] += values[i - width];
  for (let y = 0; y < height; y++) {
    for (let i = y * width + 1; i < (y + 1) * width; i++) values[i] += values[i - 1];
  }
  return values;
}

async function unpackMaps(facts) {
  if (!window.DecompressionStream) throw new TooOld();
  const maps = {};
  await Promise.all(facts.maps.map(async (each) => {
    maps[each.name] = await unpackMap(each);
  }));
  const { width, height } = facts.camera;
  const surface = (name) => {
    const depth = metres(maps["depth-" + name], facts.depth);
    return { depth, normals: packNormals(maps[name + "-a"], maps[name + "-b"], depth) };
  };
  return { width, height, after: surface("after"), before: surface("before"), paint: packPaint(maps) };
}

function metres(values, { nearest_m, step_m }) {
  const depth = new Float32Array(values.length);
  for (let i = 0; i < values.length; i++) {
    depth[i] = values[i] ? nearest_m + (values[i] - 1) * step_m : NaN;
  }
  return depth;
}

// 10 bits for each of x, y, z, and whether the pixel shows the object: a texture that filters.
function packNormals(a, b, depth) {
  const packed = new Uint32Array(a.length);
  for (let i = 0; i < a.length; i++) {
    let x = a[i] / 2047.5 - 1, y = b[i] / 2047.5 - 1;
    const z = Math.abs(x) + Math.abs(y) - 1;
    if (z > 0) {
      const folded = (1 - Math.abs(y)) * Math.sign(x);
      y = (1 - Math.abs(x)) * Math.sign(y);
      x = folded;
    }
    const scale = 511.5 / Math.hypot(x, y, z);
    packed[i] = (Math.round(511.5 + scale * x)
      | (Math.round(511.5 + scale * y) << 10)
      | (Math.round(511.5 + scale * z) << 20)
      | (Number.isNaN(depth[i]) ? 0 : 3 << 30)) >>> 0;
  }
  return packed;
}

function packPaint({ red, green, blue, confidence }) {
  const paint = new Uint8Array(4 * red.length);
  for (let i = 0; i < red.length; i++) {
    paint[4 * i] = red[i];
    paint[4 * i + 1] = green[i];
    paint[4 * i + 2] = blue[i];
    paint[4 * i + 3] = confidence[i];
  }
  return paint;
}
