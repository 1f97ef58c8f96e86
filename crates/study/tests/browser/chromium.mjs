// A page in headless Chromium, as a person would open one, for the tests of pages.
import { mkdtempSync, rmSync } from 'node:fs';
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
