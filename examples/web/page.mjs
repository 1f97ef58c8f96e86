// node examples/web/page.mjs [SCREENSHOT.png]: opens the page of `examples/web/build` in headless Chromium as a visitor would.
import { fileURLToPath } from 'node:url';
// `.ci/browser` installs its library.
import { overflow, served, visited } from '../../crates/study/tests/browser/chromium.mjs';

const server = await served(fileURLToPath(new URL('../../target/web/', import.meta.url)));
const wrong = [];
const check = (good, words) => { if (!good) wrong.push(words); };
await visited(wrong, async (page) => {
  await page.setViewportSize({ width: 1100, height: 950 });
  await page.goto(`${server.address}/`);
  const done = () => page.waitForSelector('body[data-state=done]', { timeout: 120_000 });
  const value = (name) => page.evaluate((name) => Number(document.body.dataset[name]), name);
  await done();
  const [uniform, adaptive] = [await value('uniform'), await value('adaptive')];
  check(adaptive < 0.15 * uniform && adaptive > 0, `at 8 samples per pixel, errors of ${uniform} and ${adaptive}`);
  if (process.argv[2]) await page.screenshot({ path: process.argv[2] });

  // Sliders restart the renders, even while they run.
  await page.locator('#seed').fill('3');
  await page.locator('#spp').fill('4');
  await page.waitForSelector('body[data-state=running]');
  await done();
  const more = await value('uniform');
  check(more < 0.95 * uniform, `with 16 samples per pixel, an error of ${more} after ${uniform} with 8`);
  const frames = await value('frames');
  check(frames > 10, `${frames} frames a second while it renders`);
  check((await page.locator('#adaptive-error').textContent()).startsWith('16.0 samples'), 'the samples are not those of the slider');
  for (const width of [400, 1200]) {
    await page.setViewportSize({ width, height: 900 });
    const over = await overflow(page);
    check(over <= 0, `scrolls sideways by ${over} pixels at ${width}`);
  }
  console.log(`errors ${uniform.toFixed(1)} and ${adaptive.toFixed(1)}, ${frames.toFixed(0)} frames a second`);
});
server.close();
