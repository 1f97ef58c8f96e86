// A page in headless Chromium, as a person would open one, for the tests of pages.
import { existsSync, mkdtempSync, readFileSync, rmSync, statSync } from 'node:fs';
import { createServer } from 'node:http';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { chromium } from 'playwright-core';

/** Calls `visit` with an empty page whose errors and warnings go to `wrong`. Ends the program with status 1 if anything is wrong. */
export async function visited(wrong, visit) {
  const profile = mkdtempSync(join(tmpdir(), 'dapple-chromium-'));
  const context = await chromium.launchPersistentContext(profile, {
    executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
    args: ['--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run', '--disable-background-networking', '--disable-component-update', '--disable-sync'],
  });
  try {
    const page = await context.newPage();
    page.on('console', (message) => { if (['error', 'warning'].includes(message.type())) wrong.push(`console: ${message.text()}`); });
    page.on('pageerror', (error) => wrong.push(`script: ${error}`));
    await visit(page);
  } finally {
    await context.close();
    rmSync(profile, { recursive: true, force: true });
  }
  if (wrong.length > 0) {
    console.error(wrong.join('\n'));
    process.exit(1);
  }
}

const TYPES = { html: 'text/html', js: 'text/javascript', css: 'text/css', wasm: 'application/wasm', png: 'image/png', svg: 'image/svg+xml', woff2: 'font/woff2' };

/** A server of a folder's files: its address, and a function that closes it. */
export async function served(folder) {
  const server = createServer(({ url }, response) => {
    const path = decodeURIComponent(new URL(url, 'http://localhost').pathname);
    const file = join(folder, path.endsWith('/') ? `${path}index.html` : path);
    const exists = existsSync(file) && statSync(file).isFile();
    response.writeHead(exists ? 200 : path === '/favicon.ico' ? 204 : 404, { 'content-type': TYPES[file.split('.').pop()] ?? 'text/plain' });
    response.end(exists ? readFileSync(file) : undefined);
  });
  await new Promise((listening) => server.listen(0, '127.0.0.1', listening));
  return { address: `http://127.0.0.1:${server.address().port}`, close: () => server.close() };
}

/** The pixels by which anything in a page, or in a frame of it, is too far to the right, but for boxes that scroll by themselves. */
export async function overflow(page) {
  const of = await Promise.all(page.frames().map((frame) => frame.evaluate(() => {
    document.getAnimations().forEach((animation) => animation.finish());
    const { scrollWidth, clientWidth } = document.documentElement;
    const rest = [...document.body.querySelectorAll('*')].filter((e) => !e.parentElement.closest('pre, .table-wrapper'));
    return Math.max(scrollWidth, ...rest.map((e) => Math.floor(e.getBoundingClientRect().right))) - clientWidth;
  })));
  return Math.max(...of);
}
