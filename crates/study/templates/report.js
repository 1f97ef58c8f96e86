'use strict';
// One slider moves the edge in all crops of a scene. A click on a crop, or the button, flips between the ends.
for (const view of document.querySelectorAll('.view')) {
  const slider = view.querySelector('input[type=range]');
  if (!slider) continue;
  const tiles = view.querySelector('.tiles');
  const output = view.querySelector('output');
  const button = view.querySelector('button.flip');
  const show = () => {
    tiles.style.setProperty('--split', slider.value + '%');
    output.value = slider.value + ' % method';
    slider.setAttribute('aria-valuetext', slider.value + ' % method, ' + (100 - slider.value) + ' % reference');
    button.setAttribute('aria-pressed', String(slider.value === '0'));
  };
  const flip = () => {
    slider.value = slider.value === '0' ? '100' : '0';
    show();
  };
  slider.addEventListener('input', show);
  button.addEventListener('click', flip);
  for (const crop of view.querySelectorAll('.crop')) crop.addEventListener('click', flip);
  show();
}
