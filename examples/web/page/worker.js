// The renders, beside the page's thread: it stays responsive while the filter runs.

const { instance } = await WebAssembly.instantiateStreaming(fetch('dapple_web.wasm'));
const demo = instance.exports;
const [width, height] = [demo.width(), demo.height()];

/** The pixels of uniform samples, of adaptive ones with the filter, and of the sample map. */
function images() {
  const place = demo.draw();
  const length = 4 * width * height;
  return [0, 1, 2].map((k) => new ImageData(new Uint8ClampedArray(demo.memory.buffer, place + k * length, length).slice(), width, height));
}

/** Lets a message of the page come in. */
const pause = () => new Promise((resolve) => setTimeout(resolve));

let run = 0;
onmessage = async ({ data: { spp, seed } }) => {
  const own = ++run;
  if (!demo.start(spp, seed)) throw new Error('the render does not begin');
  const began = performance.now();
  const over = [false, false];
  while (!(over[0] && over[1])) {
    let isNew = false;
    // Both renders advance together, tile by tile.
    for (const which of [0, 1].filter((which) => !over[which])) {
      const state = demo.step(which, 4);
      if (state === 3) throw new Error('a render failed');
      over[which] = state === 2;
      isNew ||= state > 0;
    }
    if (isNew) {
      const isOver = over[0] && over[1];
      postMessage({ images: images(), spp: [demo.spp(0), demo.spp(1)], seconds: (performance.now() - began) / 1000, isOver });
      await pause();
      if (own !== run) return;
    }
  }
};
postMessage({ size: [width, height] });
