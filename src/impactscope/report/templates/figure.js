'use strict';
// Reading values, enlarging and panning of the figures. The curves' path data is the only data.
(() => {
  const SVG = 'http://www.w3.org/2000/svg';
  const element = (name, attributes) => {
    const node = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    return node;
  };
  const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

  // Path data of whole numbers, "Mx yldx dy...", to sorted columns and rows.
  function decode(path) {
    const tokens = path.getAttribute('d').match(/[Ml]|-?\d+/g) || [];
    const columns = [], rows = [];
    let x = 0, y = 0, absolute = false;
    for (let i = 0; i < tokens.length;) {
      if (tokens[i] === 'M' || tokens[i] === 'l') { absolute = tokens[i] === 'M'; i += 1; continue; }
      x = absolute ? +tokens[i] : x + +tokens[i];
      y = absolute ? +tokens[i + 1] : y + +tokens[i + 1];
      columns.push(x); rows.push(y); i += 2;
    }
    return { name: path.dataset.name, columns, rows };
  }

  function nearest(columns, column) {
    let low = 0, high = columns.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (columns[middle] < column) low = middle; else high = middle;
    }
    return column - columns[low] < columns[high] - column ? low : high;
  }

  function ticks(low, high) {
    const raw = (high - low) / 10;
    const power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw * 0.999);
    const found = [];
    for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i += 1) found.push(i * step);
    return [found, Math.max(0, -Math.floor(Math.log10(step) + 1e-9))];
  }

  function setUp(svg) {
    const data = Object.fromEntries(['x0', 'x1', 'y0', 'y1', 'left', 'width', 'top', 'height', 'columns', 'rows']
      .map((key) => [key, +svg.dataset[key]]));
    const plot = svg.querySelector('svg.plot');
    const canvas = svg.parentNode;
    const curves = [...plot.querySelectorAll('.curve')].map(decode).filter((c) => c.columns.length);
    const cursor = element('path', { class: 'cursor', visibility: 'hidden' });
    const chosen = element('rect', { class: 'chosen', y: 0, height: data.rows, visibility: 'hidden' });
    plot.append(chosen, cursor);
    const readout = document.createElement('div');
    readout.className = 'readout';
    readout.hidden = true;
    readout.setAttribute('aria-live', 'polite');
    canvas.append(readout);
    let view = [0, data.columns], from = null, at = null;

    const toX = (column) => data.x0 + (data.x1 - data.x0) * column / data.columns;
    const toY = (row) => {
      const value = data.y1 - (data.y1 - data.y0) * row / data.rows;
      return svg.dataset.log === '1' ? 10 ** value : value;
    };
    const pixel = (column) => data.left + (column - view[0]) / (view[1] - view[0]) * data.width;
    const columnAt = (event) => {
      const own = svg.getBoundingClientRect();
      const scale = own.width / svg.viewBox.baseVal.width;
      const share = (event.clientX - own.left - data.left * scale) / (data.width * scale);
      return clamp(view[0] + share * (view[1] - view[0]), view[0], view[1]);
    };

    function show(low, high) {
      const least = data.columns / 200;
      const width = clamp(high - low, least, data.columns);
      low = clamp(low, 0, data.columns - width);
      view = [low, low + width];
      for (const pan of svg.querySelectorAll('svg.pan')) {
        pan.setAttribute('viewBox', `${low} 0 ${width} ${pan === plot ? data.rows : 10}`);
      }
      for (const label of svg.querySelectorAll('.floating')) {
        const a = Math.max(pixel(+label.dataset.a), data.left);
        const b = Math.min(pixel(+label.dataset.b), data.left + data.width);
        label.setAttribute('x', (a + b) / 2);
        const { name, short, character } = label.dataset;
        label.textContent = [name, short].find((s) => s.length * character + 4 <= b - a) || '';
      }
      const axis = svg.querySelector('.x-axis');
      const [marks, decimals] = ticks(toX(low), toX(low + width));
      axis.replaceChildren(...marks.flatMap((mark) => {
        const x = pixel((mark - data.x0) / (data.x1 - data.x0) * data.columns);
        const text = element('text', { class: 'tick-x', x, y: data.top + data.height + 16 });
        text.textContent = mark.toFixed(decimals).replace(/^-(0\.?0*)$/, '$1');
        return [element('path', { class: 'grid', d: `M${x} ${data.top}v${data.height}` }), text];
      }));
    }

    function read(column) {
      if (!curves.length) return;
      at = clamp(column, view[0], view[1]);
      const longest = curves.reduce((a, b) => (b.columns.length > a.columns.length ? b : a));
      const x = longest.columns[nearest(longest.columns, at)];
      const shown = clamp(x, view[0], view[1]);
      cursor.setAttribute('d', `M${shown} 0V${data.rows}`);
      cursor.setAttribute('visibility', 'visible');
      const lines = [`${toX(x).toPrecision(5)} ${svg.dataset.xunit}`];
      for (const curve of curves) {
        const y = toY(curve.rows[nearest(curve.columns, x)]);
        lines.push(`${curve.name}: ${y.toPrecision(4)} ${svg.dataset.yunit}`);
      }
      readout.replaceChildren(...lines.map((line) => {
        const row = document.createElement('div');
        row.textContent = line;
        return row;
      }));
      readout.hidden = false;
      const scale = svg.getBoundingClientRect().width / svg.viewBox.baseVal.width;
      const left = pixel(shown) * scale;
      const right = left + 14 + readout.offsetWidth > svg.getBoundingClientRect().width;
      readout.style.left = `${right ? left - 10 - readout.offsetWidth : left + 10}px`;
      readout.style.top = `${svg.getBoundingClientRect().top - canvas.parentNode.getBoundingClientRect().top + data.top * scale + 8}px`;
    }

    function leave() {
      cursor.setAttribute('visibility', 'hidden');
      readout.hidden = true;
    }

    function mark(column) {
      chosen.setAttribute('x', Math.min(from, column));
      chosen.setAttribute('width', Math.abs(column - from));
      chosen.setAttribute('visibility', 'visible');
    }

    plot.addEventListener('pointermove', (event) => {
      const column = columnAt(event);
      read(column);
      if (from !== null) mark(column);
    });
    plot.addEventListener('pointerdown', (event) => {
      if (event.button !== 0 || event.pointerType === 'touch') return;
      from = columnAt(event);
      plot.setPointerCapture(event.pointerId);
    });
    plot.addEventListener('pointerup', (event) => {
      if (from === null) return;
      const to = columnAt(event);
      const [low, high] = [Math.min(from, to), Math.max(from, to)];
      from = null;
      chosen.setAttribute('visibility', 'hidden');
      if (high - low > (view[1] - view[0]) / 60) show(low, high);
    });
    plot.addEventListener('pointercancel', () => { from = null; chosen.setAttribute('visibility', 'hidden'); });
    plot.addEventListener('pointerleave', () => { if (from === null) leave(); });
    plot.addEventListener('dblclick', () => show(0, data.columns));
    svg.addEventListener('blur', leave);
    svg.addEventListener('keydown', (event) => {
      const width = view[1] - view[0];
      const middle = at === null ? view[0] + width / 2 : at;
      const step = width / (event.shiftKey ? 20 : 200);
      if (event.key === 'ArrowRight' || event.key === 'ArrowLeft') {
        const next = middle + (event.key === 'ArrowRight' ? step : -step);
        if (next < view[0] || next > view[1]) show(view[0] + next - middle, view[1] + next - middle);
        read(next);
      } else if (event.key === '+') { show(middle - width / 4, middle + width / 4); read(middle);
      } else if (event.key === '-') { show(middle - width, middle + width); read(middle);
      } else if (event.key === 'Escape') { show(0, data.columns); leave();
      } else return;
      event.preventDefault();
    });
  }

  // A figure is made ready when it is first touched: a page of many events opens at once.
  for (const svg of document.querySelectorAll('svg.figure')) {
    svg.setAttribute('tabindex', '0');
    const once = () => {
      svg.removeEventListener('pointerenter', once);
      svg.removeEventListener('focus', once);
      setUp(svg);
    };
    svg.addEventListener('pointerenter', once);
    svg.addEventListener('focus', once);
  }
})();
