"""Own sentences in twelve further languages, for the test set: espeak-ng's voice -> sentences."""

TEXTS: dict[str, tuple[str, ...]] = {
    "de": (
        "Der alte Mann fährt jeden Morgen mit dem Bus.", "Bitte bring mir ein Brot vom Bäcker mit.",
        "Meine Mutter pflanzt im Frühling viele Blumen.", "Fünf Vögel sitzen auf dem Baum.",
        "Wir wollen am Freitag über die Brücke gehen.", "Das Problem war schwieriger als gedacht.",
    ),
    "fr": (
        "Le petit garçon mange une pomme rouge.", "Ma voisine prend le bus chaque matin.",
        "Nous avons vu un beau film hier soir.", "Peux-tu fermer la porte, s'il te plaît?",
        "Le bateau part à neuf heures du port.", "Il fait froid, mais le soleil brille.",
    ),
    "es": (
        "El perro bebe agua fría en la cocina.", "Mi hermano vive cerca del puerto.",
        "Mañana vamos a comprar pan y fruta.", "La película fue demasiado larga.",
        "¿Puedes abrir la ventana, por favor?", "Siempre hablamos mucho por la noche.",
    ),
    "it": (
        "La mia famiglia viene da un piccolo paese.", "Domani mattina prendo il primo treno.",
        "Il bambino beve un bicchiere di latte.", "Abbiamo mangiato bene in quel posto.",
        "Puoi parlare un poco più piano?", "La finestra della camera è aperta.",
    ),
    "pt": (
        "O menino comprou um bolo para a mãe.", "Vamos beber um café depois do almoço.",
        "A minha prima mora perto do mar.", "Ontem à noite choveu muito forte.",
        "Você pode me ajudar com esta mala?", "O barco pequeno voltou bem cedo.",
    ),
    "nl": (
        "De jongen loopt elke dag naar huis.", "Mijn buurman verkoopt verse appels.",
        "Wij gaan morgen met de boot mee.", "Het was vroeger een mooi gebouw.",
        "Kun je mij het brood geven?", "Vijf mensen wachten op de trein.",
    ),
    "pl": (
        "Mama kupiła świeży chleb i mleko.", "Mój brat mieszka blisko parku.",
        "Wczoraj padał bardzo mocny deszcz.", "Proszę, zamknij powoli drzwi.",
        "Pojedziemy pociągiem nad morze.", "To był piękny, ciepły wieczór.",
    ),
    "sv": (
        "Flickan köper ett rött äpple.", "Min vän bor nära en stor park.",
        "Vi åker båt över sjön i morgon.", "Boken ligger under bordet.",
        "Kan du hjälpa mig med väskan?", "Det var en varm och fin kväll.",
    ),
    "ru": (
        "Мама купила белый хлеб и молоко.", "Мой брат живёт рядом с парком.",
        "Завтра мы поедем на поезде домой.", "Вчера вечером был сильный дождь.",
        "Пожалуйста, открой большое окно.", "Пять человек ждали автобус.",
    ),
    "tr": (
        "Babam bu sabah pazara gitti.", "Küçük kız bir bardak süt içti.",
        "Yarın vapurla karşıya geçeceğiz.", "Pencereyi açar mısın, lütfen?",
        "Komşumuz bahçede çiçek ekiyor.", "Film beklediğimden daha uzundu.",
    ),
    "fi": (
        "Äiti osti tuoretta leipää ja maitoa.", "Veljeni asuu lähellä puistoa.",
        "Huomenna menemme laivalla mummolaan.", "Voitko avata ikkunan, ole hyvä?",
        "Viisi lintua istuu puussa.", "Eilen illalla satoi paljon vettä.",
    ),
    "cs": (
        "Maminka koupila čerstvý chléb.", "Můj bratr bydlí vedle parku.",
        "Zítra pojedeme vlakem domů.", "Můžeš prosím otevřít okno?",
        "Pět ptáků sedí na stromě.", "Včera večer velmi pršelo.",
    ),
}  # fmt: skip
