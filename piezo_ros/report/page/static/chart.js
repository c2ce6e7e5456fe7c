// Copyright 2026 piezo_ros maintainers
//
// Licensed under the Apache License, Version 2.0 (the "License");
// you may not use this file except in compliance with the License.
// You may obtain a copy of the License at
//
//     http://www.apache.org/licenses/LICENSE-2.0
//
// Unless required by applicable law or agreed to in writing, software
// distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
// See the License for the specific language governing permissions and
// limitations under the License.

// Draws the charts of a page with uPlot: <div class="chart"> with the JSON of chart.py inside.
// The static drawing beside a chart stays for printing, and for browsers without scripts.
'use strict';

const piezoCharts = (() => {
  const FONT = '12px system-ui, -apple-system, "Segoe UI", Roboto, "Liberation Sans", sans-serif';
  const DASHES = {solid: [], dashed: [8, 4], dotted: [2, 3], dashdot: [8, 3, 2, 3], none: []};
  const BORDERS = {solid: 'solid', dashed: 'dashed', dotted: 'dotted', dashdot: 'dashed', none: 'solid'};

  // 'var(--ff, #0072b2)' and 'currentColor' as a colour that a canvas understands.
  function pageColour(name) {
    const style = getComputedStyle(document.documentElement);
    const variable = /^var\((--[\w-]+)(?:,\s*([^)]*))?\)$/.exec(name);
    if (variable) return style.getPropertyValue(variable[1]).trim() || variable[2];
    return name === 'currentColor' ? style.getPropertyValue('--ink').trim() : name;
  }

  function numberText(value) {
    if (value === null || value === undefined || Number.isNaN(value)) return '–';
    return String(Number(value.toPrecision(5))).replace(/-/g, '−');
  }

  // A value that is not a number is a gap: null for uPlot.
  function numbers(base64) {
    const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
    return Array.from(new Float32Array(bytes.buffer), (value) => Number.isNaN(value) ? null : value);
  }

  function axisSize(u, values, axisNumber, cycle) {
    const axis = u.axes[axisNumber];
    if (cycle > 1) return axis._size;
    u.ctx.font = axis.font[0];
    const widths = (values || []).map((text) => u.ctx.measureText(text || '').width);
    return Math.ceil(axis.ticks.size + axis.gap + Math.max(0, ...widths) / devicePixelRatio) + 2;
  }

  function axis(label, side) {
    const common = {
      label, font: FONT, labelFont: FONT, labelSize: 18, labelGap: 2, gap: 4,
      stroke: () => pageColour('currentColor'),
      grid: {stroke: () => pageColour('var(--grid)'), width: 1},
      ticks: {stroke: () => pageColour('var(--grid)'), width: 1, size: 5},
      values: (u, splits) => splits.map((value) => value === null ? '' : numberText(value)),
    };
    return side === 'y' ? {...common, size: axisSize} : {...common, size: 28, space: 60};
  }

  // Horizontal and vertical lines of a panel: limits, margins, marks.
  function drawLines(u, lines) {
    const {ctx, bbox} = u;
    ctx.save();
    ctx.lineWidth = devicePixelRatio;
    ctx.setLineDash([6 * devicePixelRatio, 4 * devicePixelRatio]);
    ctx.font = u.axes[0].font[0];
    for (const {axis: scale, value, label} of lines) {
      const {min, max} = u.scales[scale];
      if (value < min || value > max) continue;
      const at = u.valToPos(value, scale, true);
      ctx.strokeStyle = ctx.fillStyle = pageColour('var(--soft)');
      ctx.beginPath();
      if (scale === 'y') {
        ctx.moveTo(bbox.left, at);
        ctx.lineTo(bbox.left + bbox.width, at);
      } else {
        ctx.moveTo(at, bbox.top);
        ctx.lineTo(at, bbox.top + bbox.height);
      }
      ctx.stroke();
      const gap = 3 * devicePixelRatio;
      if (scale === 'y') {
        const isAtTop = at < bbox.top + 18 * devicePixelRatio;
        ctx.textAlign = 'right';
        ctx.textBaseline = isAtTop ? 'top' : 'bottom';
        ctx.fillText(label, bbox.left + bbox.width - gap, at + (isAtTop ? gap : -gap));
      } else {
        const isAtRight = at > bbox.left + 0.7 * bbox.width;
        ctx.textAlign = isAtRight ? 'right' : 'left';
        ctx.textBaseline = 'top';
        ctx.fillText(label, at + (isAtRight ? -gap : gap), bbox.top + gap);
      }
    }
    ctx.restore();
  }

  // uPlot's options of one panel, and its data.
  function panelPlot(panel, width, syncKey) {
    const tables = [];
    const series = [{label: panel.x_label, value: (u, value) => numberText(value)}];
    const bands = [];
    const add = (x, y, settings) => {
      tables.push([x, y]);
      series.push(settings);
      return series.length - 1;
    };
    const abscissas = panel.abscissas.map(numbers);
    for (const trace of panel.traces) {
      const colour = () => pageColour(trace.colour);
      const x = abscissas[trace.x];
      if (trace.band) {
        const edge = {class: 'band-edge', stroke: 'transparent', points: {show: false}};
        const high = add(x, numbers(trace.band[1]), {...edge, label: `${trace.label}, high`});
        const low = add(x, numbers(trace.band[0]), {...edge, label: `${trace.label}, low`});
        bands.push({series: [high, low], fill: () => `color-mix(in srgb, ${colour()} 20%, transparent)`});
      }
      const hasLine = trace.style !== 'none';
      add(x, numbers(trace.y), {
        label: trace.label, class: hasLine ? null : 'marker-only', stroke: colour, width: trace.width, dash: DASHES[trace.style],
        ...(hasLine ? {} : {paths: () => null}),
        points: {
          show: trace.marker !== '', size: 6, width: 1.5, stroke: colour,
          fill: () => trace.marker === 'open' ? pageColour('var(--page)') : colour(),
        },
        value: (u, value) => numberText(value),
      });
    }
    const y = {distr: panel.log_y ? 3 : 1};
    if (panel.y_range) y.range = panel.y_range;
    const options = {
      width, height: panel.height,
      scales: {x: {time: false, distr: panel.log_x ? 3 : 1}, y},
      axes: [axis(panel.x_label, 'x'), axis(panel.y_label, 'y')],
      series, bands,
      cursor: {
        y: false, sync: {key: syncKey}, drag: {x: true, y: false, dist: 8},
        points: {size: 7, fill: (u, number) => u.series[number].stroke(u, number)},
      },
      legend: {markers: {
        width: 3,
        dash: (u, number) => number ? BORDERS[(panel.traces.find(
          (trace) => trace.label === u.series[number].label) || {style: 'solid'}).style] : 'none',
      }},
      hooks: {drawAxes: [(u) => drawLines(u, panel.lines)]},
    };
    const joined = tables.length === 1 ? tables[0] : uPlot.join(tables);
    return {options, data: joined};
  }

  function plotOf({options, data}, element, zoomed) {
    options.hooks.setSelect = [zoomed];
    return new uPlot(options, data, element);
  }

  // One picture: its panels below each other, with a common cursor where they share x.
  class Chart {
    constructor(element) {
      this.element = element;
      this.content = JSON.parse(element.querySelector('script').textContent);
      this.plots = [];
      this.reset = document.createElement('button');
      this.reset.type = 'button';
      this.reset.textContent = 'Whole range';
      this.reset.hidden = true;
      this.reset.addEventListener('click', () => this.draw());
      element.closest('figure').classList.add('has-chart');
      element.hidden = false;
      new ResizeObserver(() => this.resize()).observe(element);
    }

    // A closed fold has no width: its charts are drawn once it opens.
    resize() {
      const width = Math.floor(this.element.clientWidth);
      if (!width || width === this.width) return;
      this.width = width;
      if (!this.plots.length) this.draw();
      else this.plots.forEach((plot) => {
        plot.setSize({width, height: plot.height});
        // Equal scales are others on axes of another width.
        if (plot.showWhole) plot.showWhole();
      });
    }

    draw() {
      if (!this.width) return;
      this.plots.forEach((plot) => plot.destroy());
      this.element.querySelectorAll('.panel-title, .readout').forEach((words) => words.remove());
      this.reset.hidden = true;
      this.element.append(this.reset);
      this.plots = this.content.panels.map((panel) => {
        if (panel.title) {
          const title = document.createElement('p');
          title.className = 'panel-title';
          title.textContent = panel.title;
          this.element.append(title);
        }
        const syncKey = `${this.content.name}:${panel.x_label}:${panel.log_x}`;
        const zoomed = () => { this.reset.hidden = false; };
        const plot = panel.kind === 'curves'
          ? piezoCurves.plot(panel, this.width, this.element, zoomed)
          : plotOf(panelPlot(panel, this.width, syncKey), this.element, zoomed);
        const picture = plot.root.querySelector('.u-wrap');
        picture.setAttribute('role', 'img');
        picture.setAttribute('aria-label', panel.title
          ? `${this.content.description} ${panel.title}` : this.content.description);
        return plot;
      });
    }
  }

  // Of this page, for the console of the browser.
  const charts = [];

  function start() {
    charts.push(...Array.from(document.querySelectorAll('.chart'), (element) => new Chart(element)));
    matchMedia('(prefers-color-scheme: dark)').addEventListener(
      'change', () => charts.forEach((chart) => chart.draw()));
  }

  return {BORDERS, DASHES, FONT, axis, charts, numberText, numbers, pageColour, start};
})();
