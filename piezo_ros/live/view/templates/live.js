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

// Asks for what is new, keeps the last samples of each rig, and draws them.
'use strict';

(() => {
  const ASK_MS = 300;
  const ASK_HIDDEN_MS = 2000;
  const PATIENCE_MS = 5000;
  const MOST_FAILURES = 20;
  const KEPT_SAMPLES = 1200;
  const SHOWN_SAMPLES = 400;
  const SAMPLES_OF_A_LINE = 10;  // in one period, from which on samples are joined
  const {axis, pageColour} = piezoCharts;

  const byId = (id) => document.getElementById(id);

  function element(tag, text = '', className = '') {
    const made = document.createElement(tag);
    made.textContent = text;
    if (className) made.className = className;
    return made;
  }

  function shortNumber(value, digits = 3) {
    if (value === null || value === undefined || !Number.isFinite(value)) return '–';
    const text = Math.abs(value) >= 10 ** digits ? String(Math.round(value)) : String(Number(value.toPrecision(digits)));
    return text.replace('-', '−');
  }

  const count = (value) => value.toLocaleString('en').replaceAll(',', '\u202f');
  const rms = (values) => Math.sqrt(values.reduce((sum, value) => sum + value * value, 0) / values.length);
  const largest = (values) => values.reduce((most, value) => Math.max(most, Math.abs(value)), 0);

  // One plot; its colours follow the page, its width the figure.
  class Plot {
    constructor(figure, {xLabel, yLabel, series, hooks = {}, yFromZero = false, xRange = null}) {
      this.place = figure.querySelector('.plot');
      this.figure = figure;
      const y = {range: (u, min, max) => {
        if (min === null) return [yFromZero ? 0 : -1, 1];
        const pad = 0.06 * (max - min) || Math.abs(max) * 0.1 || 1;
        return [yFromZero ? 0 : min - pad, max + pad];
      }};
      const x = {time: false};
      if (xRange) x.range = xRange;
      const options = {
        width: Math.max(200, this.place.clientWidth), height: 220, legend: {show: false},
        scales: {x, y}, axes: [axis(xLabel, 'x'), axis(yLabel, 'y')],
        series: [{}, ...series], hooks,
        cursor: {y: false, drag: {x: false, y: false}, points: {show: false}},
      };
      this.plot = new uPlot(options, [[], ...series.map(() => [])], this.place);
      const picture = this.plot.root.querySelector('.u-wrap');
      picture.setAttribute('role', 'img');
      this.picture = picture;
      new ResizeObserver(() => this.resize()).observe(this.place);
    }

    resize() {
      const width = Math.floor(this.place.clientWidth);
      if (width > 0 && width !== this.plot.width) this.plot.setSize({width, height: 220});
    }

    show(data, description) {
      this.plot.setData(data);
      this.picture.setAttribute('aria-label', description);
    }
  }

  const dots = (colour, size = 4) => ({
    stroke: () => pageColour(colour), paths: () => null,
    points: {show: true, size, width: 1, stroke: () => pageColour(colour), fill: () => pageColour(colour)},
  });
  const rings = (colour) => ({
    stroke: () => pageColour(colour), paths: () => null,
    points: {show: true, size: 7, width: 1.5, stroke: () => pageColour(colour), fill: 'transparent'},
  });
  const line = (colour, dash = []) => ({
    stroke: () => pageColour(colour), width: 1.5, dash, points: {show: false}, spanGaps: true,
  });
  // Samples that lie close together: points, joined by a line that is shown on demand.
  const joined = (settings, isDense) => ({
    ...settings, spanGaps: true, paths: (u, ...rest) => isDense() ? uPlot.paths.linear()(u, ...rest) : null,
  });

  // Bars with whiskers of two standard errors; pale where the whisker reaches zero.
  function drawSpectrum(spectrum) {
    return (u) => {
      const shown = spectrum();
      if (!shown) return;
      const {ctx} = u;
      const ratio = devicePixelRatio;
      ctx.save();
      ctx.beginPath();
      ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
      ctx.clip();
      const zero = u.valToPos(0, 'y', true);
      const width = Math.max(2 * ratio, 0.55 * Math.abs(u.valToPos(2, 'x', true) - u.valToPos(1, 'x', true)));
      shown.amplitudes_nm.forEach((amplitude, place) => {
        const error = 2 * shown.standard_errors_nm[place];
        const at = u.valToPos(place + 1, 'x', true);
        const top = u.valToPos(amplitude, 'y', true);
        ctx.strokeStyle = ctx.fillStyle = pageColour('var(--series-4)');
        ctx.lineWidth = ratio;
        if (amplitude > error) ctx.fillRect(at - width / 2, top, width, zero - top);
        else ctx.strokeRect(at - width / 2, top, width, zero - top);
        ctx.strokeStyle = pageColour('var(--ink)');
        ctx.beginPath();
        ctx.moveTo(at, u.valToPos(Math.max(0, amplitude - error), 'y', true));
        ctx.lineTo(at, u.valToPos(amplitude + error, 'y', true));
        ctx.stroke();
      });
      ctx.restore();
    };
  }

  function drawRails(rails) {
    return (u) => {
      const {ctx, bbox} = u;
      ctx.save();
      ctx.strokeStyle = pageColour('var(--soft)');
      ctx.lineWidth = devicePixelRatio;
      ctx.setLineDash([6 * devicePixelRatio, 4 * devicePixelRatio]);
      for (const rail of rails()) {
        if (rail < u.scales.y.min || rail > u.scales.y.max) continue;
        const at = u.valToPos(rail, 'y', true);
        ctx.beginPath();
        ctx.moveTo(bbox.left, at);
        ctx.lineTo(bbox.left + bbox.width, at);
        ctx.stroke();
      }
      ctx.restore();
    };
  }

  // One rig: its last samples, figures and plots.
  class Rig {
    constructor(name) {
      this.name = name;
      this.run = 0;
      this.sequence = 0;
      this.facts = null;
      this.tracking = [[], [], []];
      this.voltage = [[], []];
      this.section = element('section', '', 'rig');
      this.heading = element('h2', name ? `Axis ${name}` : 'Now');
      this.about = element('p', '', 'note');
      this.figures = element('dl', '', 'facts');
      this.note = element('p', '', 'note');
      const charts = element('div', '', 'charts');
      const figure = (title, caption) => {
        const made = document.createElement('figure');
        made.append(element('h3', title), element('div', '', 'plot'), caption);
        charts.append(made);
        return made;
      };
      const keys = (ofReference) => {
        const caption = document.createElement('figcaption');
        const reference = element('span', '', `key key-reference ${ofReference}`);
        caption.append(reference, 'reference', element('span', '', 'key key-displacement dot'), 'displacement');
        return caption;
      };
      this.section.append(this.heading, this.about, this.figures, this.note, charts);
      byId('rigs').append(this.section);
      const isDense = () => this.isDense;
      this.periodFigure = figure('Displacement over one period', keys('dashed'));
      this.displacementFigure = figure('Displacement', keys('ring'));
      this.voltagePeriodFigure = figure('Voltage over one period', element('figcaption'));
      this.voltageFigure = figure('Voltage', element('figcaption'));
      this.errorFigure = figure('Error, reference less displacement', element('figcaption'));
      this.spectrumFigure = figure('Harmonics', element('figcaption'));
      this.period = new Plot(this.periodFigure, {
        xLabel: 'phase (periods)', yLabel: 'µm', xRange: [0, 1],
        series: [line('var(--ink)', [7, 4]), dots('var(--series-1)')]});
      this.displacement = new Plot(this.displacementFigure, {
        xLabel: 'time of the run (s)', yLabel: 'µm',
        series: [joined(rings('var(--ink)'), isDense), joined(dots('var(--series-1)'), isDense)]});
      this.voltsPeriod = new Plot(this.voltagePeriodFigure, {
        xLabel: 'phase (periods)', yLabel: 'V', xRange: [0, 1], series: [dots('var(--series-2)')],
        hooks: {drawAxes: [drawRails(() => this.facts ? this.facts.rails_v : [])]}});
      this.error = new Plot(this.errorFigure, {
        xLabel: 'time of the run (s)', yLabel: 'nm', series: [joined(dots('var(--series-4)'), isDense)]});
      this.volts = new Plot(this.voltageFigure, {
        xLabel: 'time of the run (s)', yLabel: 'V', series: [joined(dots('var(--series-2)'), isDense)],
        hooks: {drawAxes: [drawRails(() => this.facts ? this.facts.rails_v : [])]}});
      this.spectrum = new Plot(this.spectrumFigure, {
        xLabel: 'harmonic of the scan', yLabel: 'amplitude (nm)', yFromZero: true,
        xRange: (u, min, max) => [0.3, (max || 1) + 0.7],
        series: [{stroke: 'transparent', paths: () => null, points: {show: false}}, {stroke: 'transparent', paths: () => null, points: {show: false}}],
        hooks: {draw: [drawSpectrum(() => this.analysis && this.analysis.spectrum)]}});
      this.plots = [this.period, this.displacement, this.voltsPeriod, this.volts, this.error, this.spectrum];
      this.nodes = element('tbody');
      const table = element('table', '', 'nodes');
      const head = element('thead');
      const row = element('tr');
      for (const text of ['Node', 'State', 'Sample', 'Voltage', 'Reason']) {
        const cell = element('th', text);
        cell.scope = 'col';
        row.append(cell);
      }
      head.append(row);
      table.append(head, this.nodes);
      const wide = element('div', '', 'wide');
      wide.tabIndex = 0;
      wide.setAttribute('role', 'region');
      wide.setAttribute('aria-label', `status of the nodes${name ? ` of axis ${name}` : ''}`);
      wide.append(table);
      this.section.append(wide);
    }

    take(news) {
      if (news.run !== this.run) {
        this.run = news.run;
        this.facts = news.facts;
        this.tracking = [[], [], []];
        this.voltage = [[], []];
      }
      this.sequence = news.sequence;
      this.analysis = news.analysis;
      for (const [kept, fresh] of [[this.tracking, news.tracking], [this.voltage, news.voltage]]) {
        const isOlder = fresh[0].length && kept[0].length && fresh[0][0] < kept[0][kept[0].length - 1];
        kept.forEach((column, place) => {
          if (isOlder) column.length = 0;
          column.push(...fresh[place]);
          column.splice(0, column.length - KEPT_SAMPLES);
        });
      }
      this.showNodes(news.statuses);
      if (this.facts) this.draw();
    }

    showNodes(statuses) {
      this.nodes.replaceChildren(...Object.entries(statuses).map(([node, status]) => {
        const row = element('tr');
        const name = element('th', node);
        name.scope = 'row';
        const voltage = status.voltage_v === null ? '' : `${shortNumber(status.voltage_v)} V`;
        row.append(name, element('td', status.state), element('td', count(status.index), 'number'),
          element('td', voltage, 'number'), element('td', status.reason));
        return row;
      }));
      this.plant = statuses.plant || null;
    }

    get isDense() {
      const indices = this.tracking[0].slice(-SHOWN_SAMPLES);
      if (!this.facts || !this.facts.cycle_samples || indices.length < 2) return false;
      const step = (indices[indices.length - 1] - indices[0]) / (indices.length - 1);
      return step * SAMPLES_OF_A_LINE <= this.facts.cycle_samples;
    }

    draw() {
      const {facts, analysis} = this;
      const [indices, measured, references] = this.tracking.map((column) => column.slice(-SHOWN_SAMPLES));
      const times = indices.map((index) => index * facts.sample_period_s);
      const follows = facts.follows_reference;
      this.about.textContent = `Run ${this.run}: ${facts.description}`;
      const errors = measured.map((value, place) =>
        references[place] === null ? null : 1000 * (references[place] - value));
      const isTrusted = follows && !analysis.refused_reference;
      this.errorFigure.hidden = !isTrusted;
      if (isTrusted) {
        this.error.show([times, errors], this.seen('error', 'nm', errors.filter((value) => value !== null)));
      }
      const [voltageIndices, voltages] = this.voltage.map((column) => column.slice(-SHOWN_SAMPLES));
      // Far apart, samples of what repeats say little over time: they are laid over one period.
      const isFolded = facts.period_samples !== null && !this.isDense;
      this.displacementFigure.hidden = isFolded;
      this.voltageFigure.hidden = isFolded;
      this.voltagePeriodFigure.hidden = !isFolded;
      this.periodFigure.hidden = facts.period_samples === null;
      this.displacement.show([times, references, measured], this.seen('displacement', 'µm', measured));
      this.volts.show(
        [voltageIndices.map((index) => index * facts.sample_period_s), voltages],
        this.seen('voltage', 'V', voltages));
      const rails = `Rails: ${shortNumber(facts.rails_v[0])} and ${shortNumber(facts.rails_v[1])} V from the operating point.`;
      this.voltageFigure.querySelector('figcaption').textContent = rails;
      this.voltagePeriodFigure.querySelector('figcaption').textContent = `Samples of many periods. ${rails}`;
      if (!this.periodFigure.hidden) {
        this.drawPeriod(indices, measured);
        const folded = this.folded(voltageIndices, voltages).sort((one, other) => one[0] - other[0]);
        this.voltsPeriod.show([folded.map((point) => point[0]), folded.map((point) => point[1])],
          this.seen('voltage over one period', 'V', folded.map((point) => point[1])));
      }
      this.drawSpectrum();
      this.showFigures(voltages);
    }

    seen(what, unit, values) {
      if (!values.length) return `${what}: no sample yet`;
      return `${what}, the last ${values.length} samples that were seen: RMS ${shortNumber(rms(values))} ${unit}, ` +
        `largest ${shortNumber(largest(values))} ${unit}`;
    }

    // Phase and value of the samples after the soft start.
    folded(indices, values) {
      const points = [];
      indices.forEach((index, place) => {
        if (index >= this.analysis.from_sample) points.push([(index / this.facts.period_samples) % 1, values[place]]);
      });
      return points;
    }

    drawPeriod(indices, measured) {
      const {outline} = this.facts;
      const samples = this.folded(indices, measured);
      const points = [
        ...samples.map(([phase, value]) => [phase, null, value]),
        ...outline.map(([phase, value]) => [phase, value, null])];
      points.sort((one, other) => one[0] - other[0]);
      this.period.show([0, 1, 2].map((column) => points.map((point) => point[column])),
        `${samples.length} samples of the displacement over one period` +
        (outline.length ? ', with the reference' : ''));
      this.periodFigure.querySelector('.key-reference').hidden = !outline.length;
    }

    drawSpectrum() {
      const {analysis} = this;
      const {spectrum} = analysis;
      const ofError = analysis.signal === 'error';
      const caption = this.spectrumFigure.querySelector('figcaption');
      this.spectrumFigure.querySelector('h3').textContent =
        ofError ? 'Error by harmonic' : 'Displacement by harmonic';
      if (!spectrum) {
        this.spectrum.show([[], [], []], 'no spectrum yet');
        caption.textContent = `No spectrum: ${analysis.refused_spectrum || analysis.refused || 'no sample yet'}.`;
        return;
      }
      const numbers = spectrum.amplitudes_nm.map((_, place) => place + 1);
      const tops = spectrum.amplitudes_nm.map((value, place) => value + 2 * spectrum.standard_errors_nm[place]);
      this.spectrum.show([numbers, spectrum.amplitudes_nm, tops],
        `amplitude of harmonics 1 to ${numbers.length}, the largest ${shortNumber(largest(spectrum.amplitudes_nm))} nm`);
      caption.textContent =
        `${analysis.samples} samples. Whiskers: two standard errors; hollow bars reach no further. ` +
        `Not in harmonics 1 to ${numbers.length} (noise, transient, drift, higher ones): ` +
        `${shortNumber(spectrum.rest_rms_nm)} nm RMS.`;
    }

    showFigures(voltages) {
      const {analysis, facts, plant} = this;
      const shown = [];
      if (analysis.nrmse_percent !== undefined) shown.push(['NRMSE, estimate', `${shortNumber(analysis.nrmse_percent)} ± ${shortNumber(analysis.nrmse_percent * analysis.relative_doubt, 2)} %`]);
      if (analysis.rms_nm !== undefined) {
        shown.push(['RMS error, estimate', `${shortNumber(analysis.rms_nm)} ± ${shortNumber(analysis.rms_nm * analysis.relative_doubt, 2)} nm`]);
        shown.push([`largest of ${analysis.samples} samples seen`, `${shortNumber(analysis.largest_nm)} nm`]);
      }
      if (voltages.length) shown.push(['voltage, newest seen', `${shortNumber(voltages[voltages.length - 1])} V`]);
      if (plant) {
        shown.push(['sample', `${count(plant.index)} of ${count(facts.samples)}`]);
        if (plant.elapsed_s > 0) shown.push(['samples a second', count(Math.round(plant.index / plant.elapsed_s))]);
      }
      this.figures.replaceChildren(...shown.map(([name, value]) => {
        const pair = element('div');
        pair.append(element('dt', name), element('dd', value));
        return pair;
      }));
      this.note.textContent = analysis.refused ? `No estimates: ${analysis.refused}.` : '';
      this.note.classList.toggle('refused', Boolean(analysis.refused_reference));
    }
  }

  const rigs = new Map();
  let failures = 0;
  let ended = false;

  function showState(text, kind) {
    const state = byId('state');
    if (state.textContent !== text) state.textContent = text;
    state.className = `state ${kind}`;
  }

  function show(news) {
    byId('title').textContent = news.title;
    byId('announced').textContent = news.announced;
    byId('share').value = news.share_done;
    byId('share-text').textContent = `${Math.round(100 * news.share_done)} % of this run`;
    byId('runs-text').textContent = news.runs_total
      ? `${news.runs_begun} of ${news.runs_total} begun.` : `${news.runs_begun} begun.`;
    byId('runs').replaceChildren(...news.runs.map((run) => {
      const row = element('tr');
      row.append(element('td', String(run.number), 'number'), element('td', run.description),
        element('td', run.state, 'run-state'), element('td', run.detail));
      return row;
    }));
    document.title = `${Math.round(100 * news.share_done)} % · ${news.title}`;
    for (const each of news.rigs) {
      if (!rigs.has(each.name)) rigs.set(each.name, new Rig(each.name));
      rigs.get(each.name).take(each);
    }
    if (news.ended) {
      ended = true;
      byId('stop').disabled = true;
      if (news.ended.exit_code === 0) showState('done', 'done');
      else showState(`ended with exit code ${news.ended.exit_code}`, 'failed');
    } else if (news.is_stopping) {
      byId('stop').disabled = true;
      showState('stopping: the voltage goes to zero', 'failed');
    } else {
      byId('stop').disabled = false;
      showState('running', 'running');
    }
  }

  async function ask() {
    const query = new URLSearchParams();
    rigs.forEach((rig, name) => query.set(`rig_${name}`, `${rig.run}.${rig.sequence}`));
    try {
      const answer = await fetch(`data?${query}`, {signal: AbortSignal.timeout(PATIENCE_MS)});
      if (!answer.ok) throw new Error(await answer.text());
      show(await answer.json());
      failures = 0;
    } catch (error) {
      failures += 1;
      if (failures > 2) {
        byId('stop').disabled = true;
        showState('no answer: piezo run has ended, or hangs. What is shown is the last that was seen; Ctrl-C in its terminal stops it', 'failed');
      }
    }
    if (ended || failures > MOST_FAILURES) return;
    setTimeout(ask, failures > 2 || document.hidden ? ASK_HIDDEN_MS : ASK_MS);
  }

  byId('stop').disabled = true;
  byId('stop').addEventListener('click', async () => {
    byId('stop').disabled = true;
    showState('asking to stop …', 'failed');
    try {
      const answer = await fetch('stop', {method: 'POST', signal: AbortSignal.timeout(PATIENCE_MS)});
      if (!answer.ok) throw new Error(await answer.text());
    } catch (error) {
      showState('the stop did not reach piezo run: press Ctrl-C in its terminal', 'failed');
      byId('stop').disabled = false;
    }
  });
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => {
    for (const rig of rigs.values()) rig.plots.forEach(({plot}) => plot.redraw());
  });
  ask();
})();
