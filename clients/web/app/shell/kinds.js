// SPDX-License-Identifier: Apache-2.0
// Fits the page to the kind of the volume: elements with data-needs appear only where they have a meaning (core/kinds.js), and so do
// layouts with slices.

export function install({ viewer, connection, layout, modes, toolbar }) {
  let left = null; // the layout of before, which this volume does not have

  function fitLayout(hasSlices) {
    if (!hasSlices && layout.showsSlices) {
      left = layout.current;
      layout.set('3d');
    } else if (hasSlices && left) {
      if (layout.current === '3d') layout.set(left);
      left = null;
    }
  }

  function follow() {
    if (!viewer.isCurrent) return;
    const { offers } = viewer;
    const { dataset } = document.body;
    const before = dataset.offers?.split(' ') ?? offers;
    fitLayout(offers.includes('grid'));
    if (dataset.offers === offers.join(' ')) return;
    dataset.offers = offers.join(' ');
    if (before.some((name) => !offers.includes(name))) modes.leave();
    toolbar.plan();
  }

  viewer.on('view', follow);
  connection.on('volumes', follow);
}
