// SPDX-License-Identifier: Apache-2.0
// The buttons and keys of the tools that draw measurements. They are there before the tools (../announce.js).

export const TOOLS = [
  { kind: 'distance', icon: 'ruler', key: 'd' }, { kind: 'angle', icon: 'triangle-right', key: 'a' },
  { kind: 'profile', icon: 'chart-line', key: 'i', needs: 'grid' }, { kind: 'rectangle', icon: 'square-dashed', key: 'r', needs: 'grid' },
  { kind: 'ellipse', icon: 'circle-dashed', key: 'e', needs: 'grid' }, { kind: 'marker', icon: 'map-pin', key: 'm' },
  { kind: 'part', icon: 'cuboid', key: 'b', needs: 'grid' }, { kind: 'path', icon: 'spline', key: 'n', needs: 'grid' },
];
