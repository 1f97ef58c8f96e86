// node examples/web/test.mjs: checks that the module of `examples/web/build` is bit-identical to a native render, without a clock or threads.
import { readFileSync } from 'node:fs';
import { fileURLToPath } from 'node:url';

const read = (path) => readFileSync(fileURLToPath(new URL(path, import.meta.url)));
const { instance } = await WebAssembly.instantiate(read('../../target/web/dapple_web.wasm'));
const demo = instance.exports;
if (!demo.start(8, 7)) throw new Error('the render does not begin');
const found = [0, 1].map((which) => {
  const began = performance.now();
  let state = 0;
  while (state < 2) state = demo.step(which, 1000);
  if (state !== 2) throw new Error(`render ${which} failed`);
  console.log(`render ${which}: ${((performance.now() - began) / 1000).toFixed(2)} s`);
  return demo.fingerprint(which) >>> 0;
});
found.push(demo.denoised_fingerprint() >>> 0);
const expected = read('fingerprints.txt').toString().trim();
if (found.join(' ') !== expected) throw new Error(`the bits are ${found.join(' ')}, natively ${expected}`);
console.log('the bits are those of a native render');
