// Page Up and Page Down lead to the episodes before and after, whether this one can be shown or not.
const LINKS = { PageUp: 'a[rel="prev"]', PageDown: 'a[rel="next"]' };

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select") || !(event.code in LINKS)) return;
  event.preventDefault();
  document.querySelector(LINKS[event.code])?.click();
});
