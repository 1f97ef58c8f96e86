'use strict';
// Columns sort by a click on their titles: ascending, descending, and the study's order.
const valueOf = (row, column) => {
  const cell = row.cells[column];
  const figure = cell?.querySelector('data');
  const text = figure ? figure.getAttribute('value') : (cell?.innerText ?? '').trim();
  const number = Number(text);
  return text === '' || text === '–' ? null : Number.isFinite(number) ? number : text;
};
const compare = (a, b) => (typeof a === 'number' && typeof b === 'number' ? a - b : String(a).localeCompare(String(b), 'en', { numeric: true }));
for (const table of document.querySelectorAll('table')) {
  const body = table.tBodies[0];
  const original = [...body.rows];
  const heads = [...table.tHead.rows[0].cells];
  const sort = (head, column) => {
    const order = { ascending: 'descending', descending: 'none' }[head.getAttribute('aria-sort')] ?? 'ascending';
    heads.forEach((other) => other.removeAttribute('aria-sort'));
    if (order === 'none') return body.append(...original);
    head.setAttribute('aria-sort', order);
    const sign = order === 'ascending' ? 1 : -1;
    const keyed = original.map((row) => [valueOf(row, column), row]);
    keyed.sort(([a], [b]) => (a === null ? 1 : b === null ? -1 : sign * compare(a, b)));
    body.append(...keyed.map(([, row]) => row));
  };
  heads.forEach((head, column) => {
    original.forEach((row) => { if (row.cells[column]) row.cells[column].dataset.label = head.innerText.trim(); });
    if (head.classList.contains('bars')) return;
    const button = document.createElement('button');
    button.type = 'button';
    button.className = 'sort';
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener('click', () => sort(head, column));
  });
}

// Tables that are wider than their box are made compact, or else shown row by row, so that none is clipped.
const stack = () => {
  for (const box of document.querySelectorAll('.scroll')) {
    const wide = () => box.scrollWidth > box.clientWidth;
    box.classList.remove('stacked', 'compact');
    if (wide()) box.classList.add('compact');
    if (wide()) box.classList.replace('compact', 'stacked');
  }
};
window.addEventListener('resize', stack);
for (const details of document.querySelectorAll('details')) details.addEventListener('toggle', stack);
stack();

// The viewer: two images of a scene on one stage, with an edge between them, zoom and movement.
for (const viewer of document.querySelectorAll('.viewer')) {
  const find = (selector) => viewer.querySelector(selector);
  const [stage, pane, edge, split] = ['.stage', '.pane', '.edge', '.split'].map(find);
  const images = [...viewer.querySelectorAll('.stage img')];
  const at = { x: 0, y: 0, zoom: 1 };
  const show = () => {
    const { width, height } = stage.getBoundingClientRect();
    at.x = Math.min(0, Math.max(width * (1 - at.zoom), at.x));
    at.y = Math.min(0, Math.max(height * (1 - at.zoom), at.y));
    pane.style.transform = `translate(${at.x}px, ${at.y}px) scale(${at.zoom})`;
    const place = ((split.value / 100) * width - at.x) / (width * at.zoom || 1);
    pane.style.setProperty('--split', `${100 * place}%`);
    edge.style.left = `${split.value}%`;
    find('.zoom output').value = `${Number(at.zoom.toFixed(1))}×`;
    find('.swap').setAttribute('aria-pressed', String(split.value === '0'));
    split.setAttribute('aria-valuetext', `${split.value} % A`);
  };
  const pick = () => {
    const [a, b] = ['.pick-a', '.pick-b'].map((selector) => images[find(selector).value]);
    for (const image of images) image.className = image === b && image !== a ? 'b' : image === a ? 'a' : '';
    if (a === b) a.className = 'b';
    for (const image of new Set([a, b])) {
      // At full resolution where the file lies beside the page.
      const file = image.dataset.full;
      if (!file) continue;
      delete image.dataset.full;
      const full = new Image();
      full.onload = () => { image.src = full.src; };
      full.src = file;
    }
    show();
  };
  const zoom = (factor, x, y) => {
    const box = stage.getBoundingClientRect();
    const [px, py] = [x ?? box.width / 2, y ?? box.height / 2];
    const next = Math.min(64, Math.max(1, at.zoom * factor));
    at.x = px - ((px - at.x) * next) / at.zoom;
    at.y = py - ((py - at.y) * next) / at.zoom;
    at.zoom = next;
    show();
  };
  const flip = () => { split.value = split.value === '0' ? '100' : '0'; show(); };
  const fit = () => { Object.assign(at, { x: 0, y: 0, zoom: 1 }); show(); };
  const move = (x, y) => { at.x += x; at.y += y; show(); };
  split.addEventListener('input', show);
  find('.pick-a').addEventListener('change', pick);
  find('.pick-b').addEventListener('change', pick);
  find('.swap').addEventListener('click', flip);
  find('.in').addEventListener('click', () => zoom(2));
  find('.out').addEventListener('click', () => zoom(0.5));
  find('.fit').addEventListener('click', fit);
  stage.addEventListener('dblclick', fit);
  stage.addEventListener('wheel', (event) => {
    if (!event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    const box = stage.getBoundingClientRect();
    zoom(event.deltaY < 0 ? 1.25 : 0.8, event.clientX - box.left, event.clientY - box.top);
  }, { passive: false });
  const keys = { '+': () => zoom(2), '=': () => zoom(2), '-': () => zoom(0.5), 0: fit, f: flip, F: flip,
    ArrowLeft: () => move(40, 0), ArrowRight: () => move(-40, 0), ArrowUp: () => move(0, 40), ArrowDown: () => move(0, -40) };
  stage.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  let held = null;
  stage.addEventListener('pointerdown', (event) => { held = [event.clientX, event.clientY]; stage.setPointerCapture(event.pointerId); });
  stage.addEventListener('pointermove', (event) => {
    if (!held) return;
    move(event.clientX - held[0], event.clientY - held[1]);
    held = [event.clientX, event.clientY];
  });
  for (const name of ['pointerup', 'pointercancel']) stage.addEventListener(name, () => { held = null; });
  window.addEventListener('resize', show);
  pick();
}
