"""Create the tables of presses, runs, sheets and labels, with row-level security by plant."""

from alembic import op

revision = "0001"
down_revision = None

_STATEMENTS = (
    """CREATE TABLE presses (
        id smallint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
        name text NOT NULL UNIQUE,
        plant text NOT NULL,
        -- How far this press's journal was shipped: the last row of a page, and which page that row was.
        shipped_row bigint NOT NULL DEFAULT 0,
        shipped_page text NOT NULL DEFAULT '',
        shipped_label bigint NOT NULL DEFAULT 0,
        shipped_at timestamptz
    )""",
    """CREATE TABLE runs (
        id integer GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
        press_id smallint NOT NULL REFERENCES presses,
        key text NOT NULL,
        number integer NOT NULL,
        job text NOT NULL,
        job_digest text NOT NULL,
        press_digest text NOT NULL,
        detector text NOT NULL,
        source text NOT NULL,
        started timestamptz NOT NULL,
        sheets integer,
        settings jsonb NOT NULL,
        ended timestamptz,
        ending text,
        detail text,
        dropped_pages integer NOT NULL,
        dropped_evidence integer NOT NULL,
        first_time_s double precision,
        UNIQUE (press_id, key)
    )""",
    """CREATE TABLE sheets (
        run_id integer NOT NULL REFERENCES runs,
        sheet integer NOT NULL,
        press_id smallint NOT NULL,
        at timestamptz NOT NULL,
        job_page integer,
        page text NOT NULL,
        verdict text NOT NULL,
        disposition text NOT NULL,
        decided_by text,
        kind text,
        score double precision,
        threshold double precision,
        p_value double precision,
        probability double precision,
        late boolean NOT NULL,
        first_line bigint NOT NULL,
        faults jsonb NOT NULL,
        notes jsonb NOT NULL,
        details jsonb,
        evidence text,
        PRIMARY KEY (run_id, sheet)
    )""",
    """CREATE TABLE labels (
        press_id smallint NOT NULL REFERENCES presses,
        run_key text NOT NULL,
        id bigint NOT NULL,
        sheet integer,
        incident text,
        label text NOT NULL,
        note text NOT NULL,
        by text NOT NULL,
        at timestamptz NOT NULL,
        upto integer,
        undoes bigint,
        PRIMARY KEY (press_id, run_key, id)
    )""",
    "CREATE TABLE members (role name NOT NULL, plant text NOT NULL, PRIMARY KEY (role, plant))",
    # A search takes the latest of each press, or of each run of a job; most are for the few sheets that are not good.
    "CREATE INDEX sheets_by_press ON sheets (press_id, at DESC)",
    "CREATE INDEX sheets_by_kind ON sheets (press_id, kind, at DESC) WHERE verdict <> 'good'",
    "CREATE INDEX sheets_by_verdict ON sheets (press_id, verdict, at DESC) WHERE verdict <> 'good'",
    "CREATE INDEX sheets_by_run ON sheets (run_id, at DESC)",
    "CREATE INDEX sheets_to_review_by_run ON sheets (run_id, at DESC) WHERE verdict <> 'good'",
    "CREATE INDEX runs_by_press ON runs (press_id, started DESC)",
    "CREATE INDEX runs_by_job ON runs (job text_pattern_ops)",
    *(f"ALTER TABLE {name} ENABLE ROW LEVEL SECURITY" for name in ("presses", "runs", "sheets", "labels")),
    """CREATE POLICY of_plants ON presses FOR SELECT
        USING (plant IN (SELECT m.plant FROM members m WHERE m.role = current_user))""",
    *(
        f"CREATE POLICY of_plants ON {name} FOR SELECT USING (press_id IN (SELECT id FROM presses))"
        for name in ("runs", "sheets", "labels")
    ),
)


def upgrade() -> None:
    """Create all tables."""
    for statement in _STATEMENTS:
        op.execute(statement)
