// SPDX-License-Identifier: Apache-2.0
// The page around the element: ?token= names the daemon's token, ?volume= and ?session= what to show.
const view = document.getElementById('view');
const control = (id) => document.getElementById(id);
const tell = (text) => { control('told').textContent = text; };

view.addEventListener('ready', () => {
  for (const id of ['shading', 'background', 'fit', 'save']) control(id).disabled = false;
});
view.addEventListener('viewchange', ({ detail }) => {
  control('shading').checked = detail.view.shading?.mode === 'phong';
});
view.addEventListener('frame', ({ detail }) => tell(`Frame ${detail.frame}, ${detail.width} × ${detail.height}`));
view.addEventListener('error', ({ detail }) => tell(`Error: ${detail.error.message}`));

control('shading').addEventListener('change', ({ target }) => view.change({ shading: { mode: target.checked ? 'phong' : 'none' } }));
control('background').addEventListener('input', ({ target }) => {
  view.change({ background: [1, 3, 5].map((at) => parseInt(target.value.slice(at, at + 2), 16) / 255).concat(1) });
});
control('fit').addEventListener('click', () => view.fit());
control('save').addEventListener('click', async () => {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(await view.toBlob());
  link.download = 'splat-view.png';
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
});

const query = new URLSearchParams(location.search);
for (const name of ['token', 'volume', 'session', 'view']) if (query.has(name)) view.setAttribute(name, query.get(name));
view.url = '..'; // this page comes from the daemon; elsewhere it is the daemon's address
