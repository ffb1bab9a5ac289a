// What the pages do beyond HTML: copy buttons, `/` for the search, running ages, sliders, and a note when the stream is lost.
(() => {
  'use strict';
  const lost = document.getElementById('lost');
  const since = document.getElementById('lost-since');

  function age(seconds) {
    const whole = Math.max(0, Math.floor(seconds));
    for (const [unit, size, limit] of [['s', 1, 120], ['m', 60, 7200], ['h', 3600, 172800]]) {
      if (whole < limit) return `${Math.floor(whole / size)}${unit} ago`;
    }
    return `${Math.floor(whole / 86400)}d ago`;
  }

  function renewAges() {
    for (const time of document.querySelectorAll('time[datetime]')) {
      const text = age((Date.now() - Date.parse(time.dateTime)) / 1000);
      if (time.textContent !== text) time.textContent = text;
    }
  }

  async function copy(button) {
    try {
      await navigator.clipboard.writeText(button.parentElement.querySelector('code').textContent);
      button.textContent = 'Copied';
    } catch {
      button.textContent = 'Not allowed';
    }
    setTimeout(() => { button.textContent = 'Copy'; }, 1500);
  }

  function noteLoss(isLost) {
    if (!lost || lost.hidden === !isLost) return;
    if (isLost) {
      const now = new Date();
      since.dateTime = now.toISOString();
      since.title = now.toISOString();
      since.textContent = age(0);
    }
    lost.hidden = !isLost;
  }

  // The slider and the number of a weight are one value: only the number is sent.
  function joinWeight(changed) {
    const isSlider = changed.classList.contains('slider');
    const other = isSlider
      ? document.getElementById(changed.dataset.for)
      : document.querySelector(`[data-for="${CSS.escape(changed.id)}"]`);
    if (other) other.value = changed.value;
  }

  // Mistakes that came with a preview are marked at their fields.
  function markMistakes() {
    for (const field of document.querySelectorAll('#tuner [aria-invalid]')) field.removeAttribute('aria-invalid');
    for (const stale of document.querySelectorAll('#tuner .mistake')) stale.remove();
    for (const item of document.querySelectorAll('#problems [data-problem-of]')) {
      const field = document.getElementById(item.dataset.problemOf);
      if (!field) continue;
      if (field.matches('input, select, textarea')) field.setAttribute('aria-invalid', 'true');
      const mistake = document.createElement('span');
      mistake.className = 'mistake';
      mistake.textContent = item.textContent;
      (field.closest('.field') || field).append(mistake);
    }
  }

  document.addEventListener('input', (event) => {
    if (event.target.matches?.('.slider, .weight')) joinWeight(event.target);
  });
  document.addEventListener('click', (event) => {
    const button = event.target.closest?.('pre.command > button');
    if (button) copy(button);
  });
  document.addEventListener('keydown', (event) => {
    const typing = event.target.closest?.('input, select, textarea');
    const search = document.getElementById('q');
    if (event.key === '/' && !typing && search && !event.ctrlKey && !event.metaKey && !event.altKey) {
      event.preventDefault();
      search.focus();
      search.select();
    } else if (event.key === 'Escape' && typing) {
      typing.blur();
    }
  });
  document.addEventListener('htmx:sse:error', (event) => {
    if (event.detail?.status === 401) location.reload();
    else noteLoss(true);
  });
  document.addEventListener('htmx:sse:close', () => noteLoss(true));
  document.addEventListener('htmx:sse:after:connection', () => noteLoss(false));
  document.addEventListener('htmx:after:swap', () => {
    renewAges();
    if (document.getElementById('tuner')) markMistakes();
  });
  document.documentElement.classList.add('scripted');
  window.addEventListener('pagehide', () => noteLoss(false));
  if (navigator.clipboard) document.documentElement.classList.add('copies');
  setInterval(renewAges, 1000);
})();
