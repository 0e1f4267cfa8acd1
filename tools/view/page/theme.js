// Light or dark: the system's wish, until a person says otherwise on this page.
export function theme(button, onChange) {
  const system = matchMedia('(prefers-color-scheme: dark)');
  let chosen = sessionStorage.getItem('theme');
  const apply = () => {
    document.documentElement.dataset.theme = chosen ?? (system.matches ? 'dark' : 'light');
    onChange();
  };
  system.addEventListener('change', apply);
  button.addEventListener('click', () => {
    chosen = document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark';
    sessionStorage.setItem('theme', chosen);
    apply();
  });
  apply();
}
