// What a person at the page may change of the run: who is shown, the emotion, and silence. Others
// change it, too, and a run that has started anew: it is shown as it stands.

export class Controls {
  // `complain(text)` is told what could not be changed.
  constructor(get, complain) {
    Object.assign(this, { get, complain, lists: "", waiting: 0, answers: 0 });
    const feel = () => {
      const name = get("emotion").value;
      return this.ask({ emotion: name ? `${name}:${get("intensity").value}` : null });
    };
    get("avatar").onchange = () => this.ask({ avatar: get("avatar").value });
    get("emotion").onchange = feel;
    get("intensity").onchange = feel;
    get("mute").onclick = () => this.ask({ muted: get("mute").getAttribute("aria-pressed") !== "true" });
  }

  show({ avatars, emotions, avatar, emotion, muted }) {
    const { get } = this, [words, intensity] = (emotion ?? "").split(":");
    const odd = emotion && (emotion.includes("+") || !emotions.includes(words)) ? emotion : "";  // a mixture
    const lists = JSON.stringify([avatars, emotions, odd]);
    if (lists !== this.lists) {
      fill(get("avatar"), avatars.map((name) => [name, name]));
      fill(get("emotion"), [["", "no emotion picked"], ...emotions.map((name) => [name, name])]);
      if (odd) get("emotion").add(Object.assign(new Option(odd, odd), { disabled: true }));
      this.lists = lists;
    }
    get("avatar").value = avatar;
    get("emotion").value = odd || words;
    if (!get("intensity").matches(":active")) get("intensity").value = (!odd && intensity) || 1;
    get("mute").setAttribute("aria-pressed", muted);
    get("mute").textContent = muted ? "Muted" : "Mute";
    get("avatar").hidden = avatars.length < 2;
    get("emotion").hidden = !emotions.length;
    get("intensity").hidden = !words || odd !== "";
    get("mute").hidden = false;
    this.shown = { avatars, emotions, avatar, emotion, muted };
  }

  async ask(asked) {
    this.waiting++;
    let now = this.shown;
    try {
      const answer = await fetch("controls", { method: "POST", body: JSON.stringify(asked) });
      if (!answer.ok) throw Error(await answer.text());
      now = { ...this.shown, ...await answer.json() };
    } catch (error) {
      this.complain(`not changed: ${error.message}`);
    }
    this.waiting--;
    this.answers++;
    if (!this.waiting) this.show(now);
  }

  // Whether nothing was picked here since there were so many answers.
  isUpTo(answers) {
    return !this.waiting && answers === this.answers;
  }
}

function fill(select, options) {
  select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
}
