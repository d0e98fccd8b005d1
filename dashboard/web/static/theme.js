// Before the first paint: the theme chosen last time, if any. Otherwise the system's.
try {
  const theme = localStorage.getItem("holdfast-theme");
  if (theme) document.documentElement.dataset.theme = theme;
} catch { /* no storage, as in some frames: the system's theme */ }
