"""Own sentences in sixteen further languages, for the training set: none of them is in the test's
(languages.py). Short, full of what English has not: rounded front vowels, palatals, clusters.
"""

TRAINING_TEXTS: dict[str, str] = {
    "de": "Die Bäume blühen schön im März. Warum fliegt der Vogel über mein Haus? Gib mir bitte "
    "ein Messer und zwei Löffel. Abends spielen wir oft Klavier. Hübsche Schuhe kosten "
    "viel Geld.",
    "fr": "Le chien dort sous la table. Tu veux boire un verre d'eau fraîche? Son oncle vend "
    "des œufs au marché. La lune était pleine et jaune. Je cherche mes gants bleus.",
    "es": "La profesora lee un cuento muy largo. ¿Dónde está la llave de mi coche? Ayer llovió "
    "toda la tarde. Me gusta el queso con miel. El jueves voy a la montaña.",
    "it": "Il gatto nero salta sul muro. Quanto costa questo vestito verde? Ieri ho scritto una "
    "lettera a mio zio. Gli amici giocano in piazza. La zuppa è troppo calda.",
    "pt": "O avô conta histórias engraçadas. Onde fica a estação de trem? Amanhã vou lavar o "
    "carro velho. A chuva molhou o jornal. Quero pão com manteiga.",
    "nl": "De kat slaapt graag in de zon. Hoeveel kost deze gele fiets? Gisteren heb ik soep "
    "gekookt. Mijn zus schrijft een lange brief. Buiten waait een koude wind.",
    "pl": "Kot śpi pod ciepłym piecem. Gdzie jest klucz do szafy? Lubię zupę z grzybami. "
    "Chłopiec rzucił piłkę przez płot. W czwartek idziemy do teatru.",
    "sv": "Katten sover på den gröna soffan. Var ligger närmaste station? I går åt vi fisk och "
    "potatis. Min farbror spelar fiol. Snön föll hela natten.",
    "ru": "Кошка спит на тёплой печке. Где лежит мой синий шарф? Бабушка варит вкусное варенье. "
    "Дети громко поют песню. В четверг мы пойдём в театр.",
    "tr": "Kedi sıcak sobanın yanında uyuyor. Anahtarım nerede acaba? Dedem bana eski bir "
    "hikâye anlattı. Çocuklar okulda şarkı söylüyor. Yarın dağa çıkacağız.",
    "fi": "Kissa nukkuu lämpimällä sohvalla. Missä on minun sininen huivini? Isoisä kertoi "
    "hauskan tarinan. Lapset laulavat koulussa. Yöllä satoi lunta.",
    "cs": "Kočka spí na teplé peci. Kde leží můj modrý šátek? Babička vaří švestkovou "
    "marmeládu. Děti hlasitě zpívají. Ve čtvrtek půjdeme do divadla.",
    "hu": "A macska a meleg kályha mellett alszik. Hol van a kék sálam? Nagyapa vidám "
    "történetet mesélt. A gyerekek énekelnek az iskolában. Éjjel esett a hó.",
    "ro": "Pisica doarme lângă soba caldă. Unde este cheia mea? Bunica face gem de prune. "
    "Copiii cântă la școală. Mâine mergem la munte cu autobuzul.",
    "el": "Η γάτα κοιμάται στον ήλιο. Πού είναι το κλειδί μου; Ο παππούς λέει μια παλιά "
    "ιστορία. Τα παιδιά τραγουδούν δυνατά. Αύριο θα πάμε στο βουνό.",
    "id": "Kucing itu tidur di bawah meja. Di mana kunci rumah saya? Nenek memasak sup ayam "
    "yang enak. Anak-anak bernyanyi di sekolah. Besok kami pergi ke pasar.",
}  # fmt: skip
VOICES = 5  # that each language is spoken by


def sentences_of(language: str) -> list[str]:
    marks = TRAINING_TEXTS[language].replace("?", "?|").replace(".", ".|").replace(";", ";|")
    return [part.strip() for part in marks.split("|") if part.strip()]
