-- Attempts at units, and how the farm was over the last hour.
CREATE TABLE attempts (
    job     INTEGER NOT NULL,
    number  INTEGER NOT NULL,
    frame   INTEGER NOT NULL,
    tile    INTEGER NOT NULL,
    outcome TEXT NOT NULL,
    record  TEXT NOT NULL,
    PRIMARY KEY (job, number)
) WITHOUT ROWID;

CREATE TABLE moments (
    at     REAL PRIMARY KEY NOT NULL,
    record TEXT NOT NULL
) WITHOUT ROWID;
