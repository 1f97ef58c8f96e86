// node docs/book/check.mjs [FOLDER-FOR-SCREENSHOTS]: opens every page of target/book in headless Chromium, at two widths.
// Exits 1 for a script's error, a file or anchor that a link does not find, or a page that scrolls sideways.
import { mkdirSync, readdirSync } from 'node:fs';
import { join } from 'node:path';
import { fileURLToPath } from 'node:url';
// `.ci/browser` installs its library.
import { overflow, served, visited } from '../../crates/study/tests/browser/chromium.mjs';

const screenshots = process.argv[2];
if (screenshots) mkdirSync(screenshots, { recursive: true });
const folder = fileURLToPath(new URL('../../target/book/', import.meta.url));
const files = new Set(readdirSync(folder, { recursive: true }));
// The list of chapters is a part of the other pages.
const pages = [...files].filter((file) => file.endsWith('.html') && file !== 'toc.html').sort();
const server = await served(folder);
const wrong = [];
const links = new Map();
const anchors = new Map();
let at = '';

/** Opens a file at a width; notes its links and anchors. */
async function open(page, file, width) {
  at = `${file} at ${width}`;
  await page.goto(`${server.address}/${file}`);
  const over = await overflow(page);
  if (over > 0) wrong.push(`${at}: scrolls sideways by ${over} pixels`);
  if (screenshots) await page.screenshot({ path: join(screenshots, `${file.replaceAll('/', '-')}-${width}.png`) });
  links.set(file, await page.evaluate(() => [...document.querySelectorAll('[href], [src]')].map((e) => e.href || e.src)));
  anchors.set(file, new Set(await page.evaluate(() => [...document.querySelectorAll('[id], a[name]')].map((e) => e.id || e.name))));
}

/** Whether a link leads out of the site, or to a file and an anchor in it. */
function leads(link) {
  const url = new URL(link);
  if (url.origin !== server.address) return true;
  const path = decodeURIComponent(url.pathname.slice(1));
  const file = path === '' || path.endsWith('/') ? `${path}index.html` : path;
  const anchor = decodeURIComponent(url.hash.slice(1));
  return files.has(file) && (anchor === '' || !anchors.has(file) || anchors.get(file).has(anchor));
}

await visited(wrong, async (page) => {
  page.on('response', (response) => { if (response.status() >= 400) wrong.push(`${at}: no ${response.url()}`); });
  page.on('request', (request) => { if (/^https?:/.test(request.url()) && !request.url().startsWith(server.address)) wrong.push(`${at}: asked the network for ${request.url()}`); });
  for (const width of [400, 1200]) {
    await page.setViewportSize({ width, height: 900 });
    for (const file of pages) await open(page, file, width);
  }
  for (const [file, of] of links) for (const link of new Set(of)) if (!leads(link)) wrong.push(`${file}: ${link} leads nowhere`);
  if (files.has('web/dapple_web.wasm')) {
    await page.goto(`${server.address}/index.html`);
    await page.frameLocator('iframe[src="web/index.html"]').locator('body[data-state=done]').waitFor({ state: 'attached', timeout: 120_000 });
  } else {
    console.log('without the demonstration');
  }
  if (wrong.length === 0) console.log(`${pages.length} pages, ${[...links.values()].flat().length} links`);
});
server.close();
