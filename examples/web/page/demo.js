// The page of the demonstration: settings to the worker, its images to the page, and their errors.

const find = (id) => document.getElementById(id);

/** The pixels of the reference. */
async function referencePixels([width, height]) {
  const image = find('reference');
  await image.decode();
  const context = Object.assign(document.createElement('canvas'), { width, height }).getContext('2d');
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, width, height).data;
}

/** The mean squared difference of two images. */
function error(pixels, reference) {
  let sum = 0;
  for (let i = 0; i < pixels.length; i++) sum += (pixels[i] - reference[i]) ** 2;
  return (sum * 4) / 3 / pixels.length;
}

const worker = new Worker('worker.js', { type: 'module' });
const { size } = await new Promise((resolve) => { worker.onmessage = ({ data }) => resolve(data); });
const reference = await referencePixels(size);

worker.onmessage = ({ data: { images, spp, seconds, isOver } }) => {
  ['uniform', 'adaptive', 'map'].forEach((id, k) => {
    const canvas = find(id);
    [canvas.width, canvas.height] = size;
    canvas.getContext('2d').putImageData(images[k], 0, 0);
  });
  ['uniform', 'adaptive'].forEach((id, k) => {
    const value = error(images[k].data, reference);
    find(`${id}-error`).textContent = `${spp[k].toFixed(1)} samples per pixel, error ${value.toFixed(1)}.`;
    document.body.dataset[id] = value;
  });
  find('status').textContent = `${isOver ? 'Done in' : 'Rendering:'} ${seconds.toFixed(1)} s`;
  document.body.dataset.state = isOver ? 'done' : 'running';
};

function restart() {
  const [spp, seed] = [2 ** Number(find('spp').value), Number(find('seed').value)];
  [find('spp-shown').value, find('seed-shown').value] = [spp, seed];
  document.body.dataset.state = 'running';
  worker.postMessage({ spp, seed });
}
find('settings').addEventListener('input', restart);
restart();

// Frames of the page while it renders.
let [frames, since] = [0, performance.now()];
(function frame() {
  frames += 1;
  const seconds = (performance.now() - since) / 1000;
  if (seconds > 1) {
    document.body.dataset.frames = frames / seconds;
    [frames, since] = [0, performance.now()];
  }
  requestAnimationFrame(frame);
})();
