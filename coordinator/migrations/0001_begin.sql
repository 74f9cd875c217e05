-- Jobs, tiles' merged films, parts of passes that are split, workers, and a few counters.
CREATE TABLE meta (
    name  TEXT PRIMARY KEY NOT NULL,
    value INTEGER NOT NULL
);

CREATE TABLE jobs (
    id     INTEGER PRIMARY KEY NOT NULL,
    record TEXT NOT NULL
);

CREATE TABLE tiles (
    job    INTEGER NOT NULL,
    frame  INTEGER NOT NULL,
    tile   INTEGER NOT NULL,
    record TEXT NOT NULL,
    film   BLOB NOT NULL,
    ring   BLOB,
    PRIMARY KEY (job, frame, tile)
);

CREATE TABLE parts (
    job    INTEGER NOT NULL,
    frame  INTEGER NOT NULL,
    tile   INTEGER NOT NULL,
    pass   INTEGER NOT NULL,
    x      INTEGER NOT NULL,
    y      INTEGER NOT NULL,
    w      INTEGER NOT NULL,
    h      INTEGER NOT NULL,
    split  INTEGER NOT NULL,
    result BLOB NOT NULL,
    PRIMARY KEY (job, frame, tile, pass, y, x)
);

CREATE TABLE workers (
    id     INTEGER PRIMARY KEY NOT NULL,
    record TEXT NOT NULL
);
