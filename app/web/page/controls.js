// What a person at the page may change of the run: who is shown, the emotion, and silence.

export function offerControls(get, { avatars, emotions, avatar, emotion, muted }, say) {
  const [words, intensity] = (emotion ?? "").split(":");
  fill(get("avatar"), avatars.map((name) => [name, name]), avatar);
  fill(get("emotion"), [["", "no emotion picked"], ...emotions.map((name) => [name, name])], words);
  get("intensity").value = intensity ?? 1;
  get("avatar").hidden = avatars.length < 2;
  get("emotion").hidden = !emotions.length;
  get("mute").hidden = false;
  show(muted);

  function show(silent) {
    get("mute").setAttribute("aria-pressed", silent);
    get("mute").textContent = silent ? "Muted" : "Mute";
    get("intensity").hidden = !get("emotion").value;
  }

  async function ask(asked) {
    try {
      const answer = await fetch("controls", { method: "POST", body: JSON.stringify(asked) });
      if (!answer.ok) throw Error(await answer.text());
      show((await answer.json()).muted);
    } catch (error) {
      say(`not changed: ${error.message}`);
    }
  }

  const feel = () => {
    const name = get("emotion").value;
    return ask({ emotion: name ? `${name}:${get("intensity").value}` : null });
  };
  get("avatar").onchange = () => ask({ avatar: get("avatar").value });
  get("emotion").onchange = feel;
  get("intensity").onchange = feel;
  get("mute").onclick = () => ask({ muted: get("mute").getAttribute("aria-pressed") !== "true" });
}

function fill(select, options, chosen) {
  select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
  select.value = chosen;
}
