// node report.mjs REPORT.html FOLDER-FOR-SCREENSHOTS EXPECTED.json
// Opens a report as a person would; exits 1 with what is wrong.
import { readFileSync } from 'node:fs';
import { join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';
import { visited } from './chromium.mjs';

const [file, out, expectedFile] = process.argv.slice(2);
const expected = JSON.parse(readFileSync(expectedFile, 'utf8'));
const wrong = [];
const check = (good, words) => { if (!good) wrong.push(words); };
const equal = (found, wanted, words) => check(JSON.stringify(found) === JSON.stringify(wanted), `${words}: ${JSON.stringify(found)}, expected ${JSON.stringify(wanted)}`);

await visited(wrong, async (page) => {
  page.on('request', (request) => { if (!/^(file|data):/.test(request.url())) wrong.push(`asked the network for ${request.url()}`); });
  await page.setViewportSize({ width: 1280, height: 900 });
  await page.emulateMedia({ colorScheme: 'light' });
  await page.goto(pathToFileURL(resolve(file)).href);

  // Every figure is there, and is drawn.
  const count = (selector) => page.locator(selector).count();
  equal(await count('section.scene'), expected.scenes, 'scenes');
  equal(await count('.chart svg'), expected.charts, 'charts');
  equal(await count('.chart svg polyline[stroke-dasharray]'), expected.curves, 'curves');
  equal(await count('.tile .image'), expected.images, 'images');
  equal(await count('.map'), expected.maps, 'maps');
  equal(await count('.ramp'), expected.maps, 'colour bars');
  equal(await count('.viewer'), expected.viewers, 'viewers');
  equal(await count('.stage img'), expected.whole, 'whole images');
  equal(await count('link[rel=stylesheet], script[src]'), 0, 'styles and scripts from other files');
  equal(await count('.bar'), expected.bars, 'bars');
  equal(await count('table'), expected.tables, 'tables');
  const broken = await page.evaluate(async () => {
    const images = [...document.images];
    await Promise.all(images.map((image) => image.decode().catch(() => {})));
    return images.filter((image) => !image.complete || image.naturalWidth === 0).length;
  });
  equal(broken, 0, 'pictures that do not load');
  equal(await page.evaluate(() => document.body.innerText.match(/\b(NaN|inf|undefined|null)\b/)?.[0] ?? ''), '', 'words of broken numbers');

  // What readers of screens need.
  equal(await count('img:not([alt]), img[alt=""]'), 0, 'pictures without words');
  equal(await count('table:not(:has(caption))'), 0, 'tables without captions');
  equal(await count('th:not([scope])'), 0, 'headers without scope');
  const labels = await page.evaluate(() => [...document.querySelectorAll('input')].filter((i) => !i.labels?.length).length);
  equal(labels, 0, 'inputs without labels');
  const ids = await page.evaluate(() => { const all = [...document.querySelectorAll('[id]')].map((e) => e.id); return all.length - new Set(all).size; });
  equal(ids, 0, 'ids used twice');
  const dead = await page.evaluate(() => [...document.querySelectorAll('a[href^="#"]')].filter((a) => !document.querySelector(a.getAttribute('href'))).length);
  equal(dead, 0, 'links that lead nowhere');

  // A column sorts up, down, and back to the study's order; missing values come last.
  const table = page.locator('#verdicts table').first();
  if (await table.count() > 0) {
    const column = () => table.evaluate((t) => [...t.tBodies[0].rows].map((row) => row.cells[3].querySelector('data')?.value ?? ''));
    const begun = await column();
    const sorted = [...begun].sort((a, b) => a - b);
    const head = table.locator('thead button').nth(3);
    await head.click();
    equal(await column(), sorted, 'the column sorts up');
    equal(await table.locator('th[aria-sort=ascending]').count(), 1, 'the header tells its order');
    await head.focus();
    await page.keyboard.press('Enter');
    equal(await column(), sorted.reverse(), 'the column sorts down by Enter');
    await head.click();
    equal(await column(), begun, 'the third click gives the order of the study');
    // Each undecided verdict has its reason beside it.
    const bare = await page.evaluate(() => [...document.querySelectorAll('td .verdict.undecided')].filter((v) => !v.parentElement.querySelector('.why')?.textContent).length);
    equal(bare, 0, 'undecided verdicts without a reason');
    const unmarked = await page.evaluate(() => [...document.querySelectorAll('#verdicts td.loss')].filter((cell) => !cell.textContent.includes('▼')).length);
    equal(unmarked, 0, 'losses without a sign');
  }

  // The viewer: two whole images, an edge, zoom, movement, and a flip.
  if (expected.viewers > 0) {
    const viewer = page.locator('.viewer').first();
    const stage = viewer.locator('.stage');
    await stage.scrollIntoViewIfNeeded();
    const shot = async () => (await stage.screenshot()).toString('base64');
    const shown = () => viewer.locator('.stage img.a, .stage img.b').count();
    equal(await shown(), 2, 'images on the stage');
    const half = await shot();
    await viewer.locator('.swap').click();
    const [reference, all] = [await shot(), await viewer.locator('.split').inputValue()];
    equal(all, '0', 'the flip shows B');
    check(reference !== half, 'the flip changes nothing');
    await viewer.locator('.swap').click();
    check(await shot() !== reference, 'the flip back shows the same image');
    const slider = viewer.locator('.split');
    await slider.focus();
    await page.keyboard.press('End');
    const left = await shot();
    await page.keyboard.press('Home');
    check(await shot() !== left, 'the slider moves no edge by the keyboard');
    await slider.evaluate((input) => { input.value = '50'; input.dispatchEvent(new Event('input')); });
    await viewer.locator('.pick-b').selectOption({ index: 0 });
    equal(await shown(), 1, 'an image beside itself is one image');
    await viewer.locator('.pick-b').selectOption({ index: 1 });
    equal(await shown(), 2, 'another image');
    const place = () => viewer.locator('.pane').evaluate((pane) => pane.style.transform);
    const [whole, begun] = [await shot(), await place()];
    await viewer.locator('.in').click();
    equal(await viewer.locator('.zoom output').inputValue().catch(() => viewer.locator('.zoom output').innerText()), '2×', 'zoom');
    const near = await shot();
    check(near !== whole, 'zooming changes nothing');
    const box = await stage.boundingBox();
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width / 2 + 60, box.y + box.height / 2 + 30, { steps: 3 });
    await page.mouse.up();
    check(await shot() !== near, 'dragging moves nothing');
    await stage.focus();
    await page.keyboard.press('0');
    equal(await place(), begun, 'the key 0 fits the image');
  }

  // Wide and narrow, light and dark.
  const inks = {};
  // The page's own handler of the new size has run after two frames.
  const resized = async (width, height) => {
    await page.setViewportSize({ width, height });
    await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  };
  const clipped = async (width) => {
    const tables = await page.evaluate(() => [...document.querySelectorAll('.scroll')].filter((box) => box.scrollWidth > box.clientWidth).map((box) => box.getAttribute('aria-label')));
    equal(tables, [], `tables clipped at ${width} pixels`);
  };
  for (const [width, height] of [[1280, 900], [800, 900], [390, 844]]) {
    await resized(width, height);
    for (const colorScheme of ['light', 'dark']) {
      await page.emulateMedia({ colorScheme });
      const [scroll, client] = await page.evaluate(() => [document.documentElement.scrollWidth, document.documentElement.clientWidth]);
      check(scroll <= client, `at ${width} pixels the page is ${scroll} wide and scrolls sideways`);
      await clipped(width);
      inks[colorScheme] = await page.evaluate(() => {
        const style = (selector) => { const e = document.querySelector(selector); return e && getComputedStyle(e); };
        return [style('body').color, style('body').backgroundColor, style('.chart svg text')?.fill, style('.chart svg polyline[stroke-dasharray]')?.stroke];
      });
      // They take most of the time: only where the test wants them, and of pages in order.
      if (expected.screenshots && wrong.length === 0) await page.screenshot({ path: join(out, `report-${width}-${colorScheme}.png`), fullPage: true });
    }
  }
  inks.light.forEach((ink, i) => check(ink === undefined || ink !== inks.dark[i], `colour ${i} is ${ink} in light and dark`));

  // Opened, the longest tables are whole too.
  await page.evaluate(() => document.querySelectorAll('details').forEach((d) => { d.open = true; }));
  const [scroll, client] = await page.evaluate(() => [document.documentElement.scrollWidth, document.documentElement.clientWidth]);
  check(scroll <= client, `opened, at 390 pixels the page is ${scroll} wide`);
  for (const width of [390, 500, 640, 800, 1000, 1400]) {
    await resized(width, 900);
    await clipped(width);
  }
});
