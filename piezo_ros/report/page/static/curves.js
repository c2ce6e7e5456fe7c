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

// Draws panels of curves in a plane (curve_panel.py): loops, Nyquist diagrams. Below each panel
// stands the point that is nearest to the mouse.
'use strict';

const piezoCurves = (() => {
  const NEAR_PX = 40;
  const MARKER_PX = 3;
  const HINT = 'Point at a curve for its values.';

  // The ranges that fill the axes of a plot, with equal scales where the panel wants them.
  function fittedRanges(u, panel) {
    let [x, y] = [panel.x_range, panel.y_range];
    if (panel.equal) {
      const {width, height} = u.bbox;
      const perPixel = Math.max((x[1] - x[0]) / width, (y[1] - y[0]) / height);
      const around = ([low, high], pixels) => {
        const middle = 0.5 * (low + high);
        return [middle - 0.5 * perPixel * pixels, middle + 0.5 * perPixel * pixels];
      };
      [x, y] = [around(x, width), around(y, height)];
    }
    return {x, y};
  }

  function showWhole(u, panel) {
    // Other ranges have labels of another width, which leaves another size to the curves.
    for (let pass = 0; pass < 3; pass++) {
      const {x, y} = fittedRanges(u, panel);
      u.batch(() => {
        u.setScale('x', {min: x[0], max: x[1]});
        u.setScale('y', {min: y[0], max: y[1]});
      });
    }
  }

  function drawCurve(u, curve, number) {
    if (!u.series[number + 1].show) return;
    const {ctx, bbox} = u;
    const {x, y} = curve.points;
    const at = (i) => [u.valToPos(x[i], 'x', true), u.valToPos(y[i], 'y', true)];
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.strokeStyle = ctx.fillStyle = piezoCharts.pageColour(curve.colour);
    ctx.lineWidth = curve.width * devicePixelRatio;
    if (curve.style !== 'none') {
      ctx.setLineDash(piezoCharts.DASHES[curve.style].map((length) => length * devicePixelRatio));
      ctx.beginPath();
      let isGap = true;
      for (let i = 0; i < x.length; i++) {
        if (x[i] === null || y[i] === null) {
          isGap = true;
          continue;
        }
        if (isGap) ctx.moveTo(...at(i));
        else ctx.lineTo(...at(i));
        isGap = false;
      }
      ctx.stroke();
      ctx.setLineDash([]);
    }
    if (curve.marker) {
      for (let i = 0; i < x.length; i++) {
        if (x[i] === null || y[i] === null) continue;
        ctx.beginPath();
        ctx.arc(...at(i), MARKER_PX * devicePixelRatio, 0, 2 * Math.PI);
        if (curve.marker === 'filled') ctx.fill();
        else ctx.stroke();
      }
    }
    ctx.restore();
  }

  // The point of a visible curve that is nearest to a place, which is in CSS pixels.
  function nearestPoint(u, curves, left, top) {
    let nearest = null;
    let least = NEAR_PX ** 2;
    curves.forEach((curve, number) => {
      if (!u.series[number + 1].show) return;
      const {x, y} = curve.points;
      for (let i = 0; i < x.length; i++) {
        if (x[i] === null || y[i] === null) continue;
        const across = u.valToPos(x[i], 'x');
        const down = u.valToPos(y[i], 'y');
        const distance = (across - left) ** 2 + (down - top) ** 2;
        if (distance < least) {
          least = distance;
          nearest = {curve, i, across, down};
        }
      }
    });
    return nearest;
  }

  function pointText(panel, {curve, i}) {
    const {x, y, along} = curve.points;
    const said = [[panel.x_label, x[i]], [panel.y_label, y[i]]];
    if (along.length) said.unshift([panel.along_label, along[0][i]]);
    return `${curve.label}: ${said.map(
      ([label, value]) => `${label} ${piezoCharts.numberText(value)}`).join(', ')}`;
  }

  function plot(panel, width, element, zoomed) {
    const curves = panel.curves.map((curve) => ({...curve, points: {
      x: piezoCharts.numbers(curve.x), y: piezoCharts.numbers(curve.y),
      along: curve.along.map(piezoCharts.numbers)}}));
    const readout = document.createElement('p');
    readout.className = 'readout';
    readout.textContent = HINT;
    const ring = document.createElement('div');
    ring.className = 'ring';
    ring.hidden = true;
    const tell = (u) => {
      const {left, top} = u.cursor;
      const nearest = left < 0 ? null : nearestPoint(u, curves, left, top);
      ring.hidden = nearest === null;
      readout.textContent = nearest === null ? HINT : pointText(panel, nearest);
      if (nearest === null) return;
      ring.style.transform = `translate(${nearest.across}px, ${nearest.down}px)`;
      ring.style.borderColor = piezoCharts.pageColour(nearest.curve.colour);
    };
    const facets = [{scale: 'x', auto: false}, {scale: 'y', auto: false}];
    const asGiven = (u, low, high) => [low, high];
    const u = new uPlot({
      mode: 2, width, height: panel.height,
      scales: {x: {time: false, auto: false, range: asGiven}, y: {auto: false, range: asGiven}},
      axes: [piezoCharts.axis(panel.x_label, 'x'), piezoCharts.axis(panel.y_label, 'y')],
      series: [null, ...curves.map((curve) => ({
        label: curve.label, facets, class: curve.style === 'none' ? 'marker-only' : null,
        stroke: () => piezoCharts.pageColour(curve.colour), width: curve.width,
        paths: () => null, points: {show: false},
      }))],
      cursor: {
        x: false, y: false, points: {show: false}, dataIdx: () => null,
        drag: {x: true, y: true, dist: 8},
        bind: {dblclick: (u) => () => showWhole(u, panel)},
      },
      legend: {live: false, markers: {
        width: 3, dash: (u, number) => piezoCharts.BORDERS[curves[number - 1].style],
      }},
      hooks: {
        draw: [(u) => curves.forEach((curve, number) => drawCurve(u, curve, number))],
        setCursor: [tell], setSelect: [zoomed],
      },
    }, [null, ...curves.map(({points}) => [points.x, points.y])], element);
    u.over.append(ring);
    element.append(readout);
    u.showWhole = () => showWhole(u, panel);
    u.showWhole();
    return u;
  }

  return {plot};
})();
