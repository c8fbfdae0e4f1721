// Charts below each other over one time; the numbers are in the page itself.
'use strict';
const data = JSON.parse(document.getElementById('data').textContent);
const HEIGHT = 168, LABEL = 20, main = document.querySelector('main');
const SHADED = ['DISARMED', 'READY', 'STOPPING', 'FAULT']; // RUNNING stays as the paper is
let charts = [];

const colour = name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const several = data.recordings.length > 1;
const times = data.panels.flatMap(panel => panel.curves.flatMap(curve => [curve.t[0], curve.t[curve.t.length - 1]]));
const whole = [Math.min(...times), Math.max(...times)];

function key() {
  const row = (background, text) => {
    const entry = document.createElement('span'), patch = document.createElement('i');
    patch.style.background = background;
    entry.append(patch, text);
    return entry;
  };
  const modes = new Set(data.modes.map(span => span[2]).filter(mode => SHADED.includes(mode)));
  document.getElementById('key').replaceChildren(
    ...(several ? data.recordings.map((name, k) => row(colour(`series-${k % 7}`), name)) : []),
    ...[...modes].map(mode => row(colour(mode.toLowerCase()), mode)));
}

// The sample of a series that is nearest to the cursor: recordings have times of their own.
function nearest(plot, series, index, time) {
  const x = plot.data[0], y = plot.data[series];
  let before = index, after = index;
  while (before > 0 && y[before] == null) before--;
  while (after < y.length - 1 && y[after] == null) after++;
  if (y[before] == null) return after;
  if (y[after] == null) return before;
  return time - x[before] <= x[after] - time ? before : after;
}

function shade(plot) {
  const { ctx, bbox } = plot;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  const high = bbox.height / data.recordings.length; // those of several above each other, in their order
  for (const [start, end, mode, recording] of data.modes) {
    if (!SHADED.includes(mode)) continue;
    const left = plot.valToPos(start, 'x', true), right = plot.valToPos(end, 'x', true);
    ctx.fillStyle = colour(mode.toLowerCase());
    ctx.fillRect(left, bbox.top + recording * high, right - left, high);
  }
  ctx.restore();
}

// A curve that stays at one value lies in the middle.
const padded = (plot, low, high) => low == null ? [0, 1] : low === high ? [low - 1, high + 1] : uPlot.rangeNum(low, high, 0.1, true);

function options(panel, curves, last) {
  const axis = { stroke: colour('quiet'), grid: { stroke: colour('grid'), width: 1 }, ticks: { stroke: colour('grid'), width: 1 }, font: '12px system-ui, sans-serif' };
  const series = curves.map(curve => ({
    label: curve.wanted ? 'wanted' : several ? data.recordings[curve.recording] ?? data.neither : 'value',
    stroke: curve.wanted ? colour('quiet') : colour(`series-${curve.recording % 7}`),
    width: 1.5, dash: curve.wanted ? [3, 3] : [],
    points: { show: curve.t.length <= 200, size: 4 },
    value: (plot, value) => value == null ? '–' : `${+value.toPrecision(6)}`.replace('-', '−'),
    ...(curve.held ? { paths: uPlot.paths.stepped({ align: 1 }) } : {}),
  }));
  return {
    width: main.clientWidth, height: HEIGHT + (last ? LABEL : 0), padding: [8, 8, 0, 0],
    scales: { x: { time: false, range: (plot, low, high) => [low ?? whole[0], high ?? whole[1]] }, y: { range: padded } },
    cursor: { sync: { key: 'time' }, dataIdx: nearest, drag: { x: true, y: false } },
    axes: [{ ...axis, ...(last ? { label: 'time (s)', labelSize: LABEL, labelFont: '12px system-ui, sans-serif' } : {}), size: 30 }, { ...axis, size: 66, values: (plot, ticks) => ticks.map(tick => `${tick}`.replace('-', '−')) }],
    series: [{ label: 'time', value: (plot, value) => value == null ? '–' : `${value.toFixed(3)} s` }, ...series],
    hooks: { drawClear: [shade] },
  };
}

function draw() {
  charts.forEach(chart => chart.destroy());
  main.replaceChildren();
  key();
  charts = data.panels.map((panel, place) => {
    const section = document.createElement('section'), heading = document.createElement('h2');
    heading.textContent = panel.label;
    section.append(heading);
    main.append(section);
    const curves = panel.wanted ? [...panel.curves, { ...panel.wanted, wanted: true }] : panel.curves;
    return new uPlot(options(panel, curves, place === data.panels.length - 1), uPlot.join(curves.map(curve => [curve.t, curve.y])), section);
  });
  everything();
}

function everything() {
  charts.forEach(chart => chart.setScale('x', { min: whole[0], max: whole[1] }));
}

document.querySelector('button').addEventListener('click', everything);
addEventListener('resize', () => charts.forEach(chart => chart.setSize({ width: main.clientWidth, height: chart.height })));
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', draw);
draw();
