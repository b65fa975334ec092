"""``prooflight serve``: the console in a browser, its users, and ``prooflight audit verify``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from prooflight.cli import event_log, faults, show
from prooflight.cli.event_log import LogOption
from prooflight.cli.options import Json
from prooflight.errors import RequestError, visible

if TYPE_CHECKING:
    from prooflight_console.accounts.account_store import Accounts
    from prooflight_console.running import Listening

app = typer.Typer(
    help="Serve the console, which shows runs of a press in a browser.", invoke_without_command=True
)
user = typer.Typer(help="Manage the users of the console.", no_args_is_help=True)
audit = typer.Typer(help="Check the record of actions in the console.", no_args_is_help=True)
app.add_typer(user, name="user")

JournalUrl = Annotated[
    str | None,
    typer.Option(
        "--journal", metavar="URL", help="Journal: sqlite:///FILE, or the file; default in the user's data."
    ),
]
Data = Annotated[
    Path | None,
    typer.Option("--data", metavar="FILE", help="The console's own file; default next to the journal."),
]
Name = Annotated[str, typer.Argument(metavar="NAME")]
RoleOption = Annotated[
    str, typer.Option("--role", metavar="ROLE", help="Role of the user: viewer, operator, engineer or admin.")
]
Address = Annotated[
    str,
    typer.Option("--address", metavar="URL", help="Address of the console, for the link that is printed."),
]
PressOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--press", metavar="X.press", help="Press of runs in the journal; replays and pictures need it."
    ),
]
JobOption = Annotated[
    list[Path] | None,
    typer.Option("--job", metavar="JOB", help="Job of runs in the journal; pictures of whole pages need it."),
]
HostOption = Annotated[str, typer.Option(help="Address to listen at; others than loopback need TLS.")]
PortOption = Annotated[int, typer.Option(help="Port to listen at; 0: any free port.", min=0, max=65_535)]
CertificateOption = Annotated[
    Path | None, typer.Option("--tls-cert", metavar="PEM", help="Certificates for TLS.")
]
KeyOption = Annotated[Path | None, typer.Option("--tls-key", metavar="PEM", help="Key of the certificates.")]
OriginOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="URL", help="Another address by which browsers reach the console, such as that of a proxy."
    ),
]
TrustedProxyOption = Annotated[
    list[str] | None,
    typer.Option(metavar="ADDRESS", help="Address or network of a proxy whose X-Forwarded-For is trusted."),
]
TraysOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="The controller's log of its trays, which may grow: as `run reconcile --trays`.",
    ),
]
QueueOption = Annotated[
    Path | None,
    typer.Option("--queue", metavar="FOLDER", help="Hot folder of jobs: shown, and filled from the browser."),
]
ScansOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--scans",
        metavar="SCANS",
        help="Recorded scans of a --job's good pages, for training in the console.",
    ),
]
PressFileOption = Annotated[
    Path | None,
    typer.Option(
        "--press-file", metavar="PRESS.toml", help="Press file, for building the press again in the console."
    ),
]
RecordsOption = Annotated[
    str | None,
    typer.Option(
        "--records",
        metavar="URL",
        envvar="PROOFLIGHT_RECORDS",
        show_envvar=False,
        help="Database of many presses to show as well; default $PROOFLIGHT_RECORDS.",
    ),
]
OidcOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.toml", help="OpenID provider for sign-in, in addition to console accounts: [oidc]."
    ),
]
TilesMbOption = Annotated[
    int,
    typer.Option("--tiles", metavar="MB", help="Megabytes for pictures of pages.", min=10, max=1_000_000),
]
DemoOption = Annotated[
    bool, typer.Option("--demo", help="Print a job live on the simulated press, and watch it.")
]
BROKEN = 1
"""Exit code of ``audit verify`` if the audit was altered."""
HERE = "http://127.0.0.1:8080"


def register(program: typer.Typer) -> None:
    """Add these commands to the program."""
    program.add_typer(app, name="serve")
    program.add_typer(audit, name="audit")


@app.callback()
def serve(
    context: typer.Context,
    journal: JournalUrl = None,
    data: Data = None,
    press: PressOption = None,
    job: JobOption = None,
    host: HostOption = "127.0.0.1",
    port: PortOption = 8080,
    certificate: CertificateOption = None,
    key: KeyOption = None,
    origin: OriginOption = None,
    trusted_proxy: TrustedProxyOption = None,
    trays: TraysOption = None,
    queue: QueueOption = None,
    scans: ScansOption = None,
    press_file: PressFileOption = None,
    records: RecordsOption = None,
    oidc: OidcOption = None,
    tiles_mb: TilesMbOption = 2000,
    demo: DemoOption = False,
    log: LogOption = "text",
) -> None:
    """Serve the console: runs, sheets and incidents in a browser, live. Ctrl-C ends it.

    It reads the journal that `watch` writes, and delays no verdict. Its first start prints a link by which
    the first admin chooses a password.
    """
    if context.invoked_subcommand is not None:
        return
    event_log.begin(log)
    from prooflight_console.accounts.provider_file import ProviderSettings
    from prooflight_console.running import Listening
    from prooflight_console.running import serve as run
    from prooflight_console.settings import ConsoleSettings
    from prooflight_line.journal.opening import default_journal, journal_path
    from prooflight_line.plant.gate.reconciling import read_trays

    listening = Listening(host=host, port=port, certificate=certificate, key=key)
    listening.check()
    if demo:
        _serve_demo(listening)
        return
    if len(scans or ()) > len(job or ()):
        raise RequestError("--scans", "has no job", remedy="give --job and --scans in the same order")
    for path in (*(press or ()), *(job or ()), *(scans or ()), *((press_file,) if press_file else ())):
        if not path.exists():
            raise RequestError(
                path, "does not exist", remedy="give the artefact or job of a run, or leave it out"
            )
    if trays is not None:
        read_trays(trays)
    path = journal_path(journal or str(default_journal()))
    provider = None if oidc is None else ProviderSettings.read(oidc)
    addresses = (*(origin or ()), *(() if provider is None else (provider.address,)))
    settings = ConsoleSettings.of(
        path,
        data=data,
        tiles_bytes=tiles_mb * 10**6,
        presses=tuple(press or ()),
        jobs=tuple(job or ()),
        scans=tuple(scans or ()),
        press_file=press_file,
        secure=certificate is not None or any(one.startswith("https:") for one in addresses),
        origins=addresses,
        trays=None if trays is None else trays.absolute(),
        queue=queue,
        records=records,
        trusted_proxies=tuple(map(_network, trusted_proxy or ())),
        provider=provider,
    )
    run(settings, listening, ready=print_address)


def _serve_demo(listening: Listening) -> None:
    """Watch the simulated press print, with the console beside it; its misprints are intended."""
    from prooflight_console.cli.live_demo import ended, live_demo

    try:
        live_demo(listening)
    except typer.Exit as error:
        raise typer.Exit(ended(error)) from error


def _network(text: str) -> str:
    """Return an address or a network of proxies; RequestError if the text is neither."""
    import ipaddress

    try:
        return (
            str(ipaddress.ip_network(text, strict=False)) if "/" in text else str(ipaddress.ip_address(text))
        )
    except ValueError as error:
        remedy = "give an address such as 127.0.0.1, or a network such as 10.0.0.0/24"
        raise RequestError("--trusted-proxy", f"{text[:60]!r} is not an address", remedy=remedy) from error


def print_address(address: str, link: str | None) -> None:
    """Print the console's address, and the link for its first admin; this link is in no log and works once."""
    if event_log.write("listening", address=address):
        return  # `prooflight serve user link` prints one
    show.people.print("The console is at", show.strong(address), "- Ctrl-C ends it.", soft_wrap=True)
    if link is not None:
        show.people.print("No user can sign in yet. Open this link once to choose the admin's password:")
        show.people.print(link, soft_wrap=True, highlight=False)


@user.command("add")
def add(
    name: Name,
    role: RoleOption = "operator",
    address: Address = HERE,
    journal: JournalUrl = None,
    data: Data = None,
    json: Json = False,
) -> None:
    """Add a user, and print the link by which they choose a password."""
    from prooflight_console.accounts.roles import Role

    if role not in list(Role):
        raise RequestError("role", f"there is no {role[:40]!r}", remedy=f"choose {', '.join(Role)}")
    accounts = _accounts(journal, data)
    _link(name, accounts.add(name, Role(role), by=_me()), address, json=json)


@user.command("link")
def link(
    name: Name, address: Address = HERE, journal: JournalUrl = None, data: Data = None, json: Json = False
) -> None:
    """Print a new link for a user who lost theirs, or their password."""
    accounts = _accounts(journal, data)
    _link(name, accounts.link(name, by=_me()), address, json=json)


@user.command("token")
def token(
    name: Name,
    scope: Annotated[
        list[str] | None, typer.Option("--scope", metavar="SCOPE", help="Scope of the token; default read.")
    ] = None,
    journal: JournalUrl = None,
    data: Data = None,
) -> None:
    """Print a new token of a user for a program, such as Prometheus; it is shown only once."""
    from prooflight_console.accounts.roles import Scope

    for one in scope or ():
        if one not in list(Scope):
            raise RequestError("scope", f"there is no {one[:40]!r}", remedy=f"choose {', '.join(Scope)}")
    scopes = [Scope(one) for one in scope or [Scope.READ]]
    _, secret = _accounts(journal, data).new_token(name, "command line", scopes, by=_me())
    show.people.print(secret, soft_wrap=True, highlight=False)


@user.command("list")
def users(journal: JournalUrl = None, data: Data = None, json: Json = False) -> None:
    """List all users."""
    from dataclasses import asdict

    people = _accounts(journal, data).people()
    if json:
        show.print_json([asdict(person) for person in people])
        return
    table = Table(title="Users", title_justify="left")
    for heading in ("name", "role", "state"):
        table.add_column(heading)
    for person in people:
        at = "" if person.issuer is None else f"signs in at {person.issuer}"
        state = "locked out" if person.locked else at if person.ready else "has chosen no password yet"
        table.add_row(visible(person.name), person.role, visible(state))
    show.people.print(
        table if people else "There are no users yet: `prooflight serve` prints a link for the first admin."
    )


@user.command("change")
def change(
    name: Name,
    role: Annotated[str | None, typer.Option("--role", metavar="ROLE", help="New role of the user.")] = None,
    locked: Annotated[
        bool | None, typer.Option("--lock/--unlock", help="Lock the user out, or let them in again.")
    ] = None,
    journal: JournalUrl = None,
    data: Data = None,
    json: Json = False,
) -> None:
    """Give a user another role, or lock them out; their sessions end at once."""
    from dataclasses import asdict

    from prooflight_console.accounts.roles import Role

    if role is not None and role not in list(Role):
        raise RequestError("role", f"there is no {role[:40]!r}", remedy=f"choose {', '.join(Role)}")
    wanted = None if role is None else Role(role)
    person = _accounts(journal, data).change(name, by=_me(), role=wanted, locked=locked)
    if json:
        show.print_json(asdict(person))
    else:
        show.people.print(f"{visible(person.name)}: {person.role}{', locked out' if person.locked else ''}")


@audit.command("verify")
def verify(
    head: Annotated[
        str | None,
        typer.Option("--head", metavar="SHA256", help="Head that was noted earlier and must still be there."),
    ] = None,
    journal: JournalUrl = None,
    data: Data = None,
    json: Json = False,
) -> None:
    """Verify that no row of the console's audit was changed; exits 1 if one was.

    Store the printed head elsewhere: with --head it then also reports whether the end was cut off.
    """
    from dataclasses import asdict

    chain = _accounts(journal, data, must_exist=True).verified(expected_head=head)
    if json:
        show.print_json(asdict(chain) | {"whole": chain.whole})
    elif chain.whole:
        show.people.print(f"The audit is intact: {chain.entries:,} rows, head {chain.head}", soft_wrap=True)
    else:
        faults.report(f"the audit is broken: {chain.why}")
    if not chain.whole:
        raise typer.Exit(BROKEN)


def _accounts(journal: str | None, data: Path | None, *, must_exist: bool = False) -> Accounts:
    from prooflight_console.accounts.account_store import Accounts
    from prooflight_console.settings import ConsoleSettings
    from prooflight_line.journal.opening import default_journal, journal_path

    settings = ConsoleSettings.of(journal_path(journal or str(default_journal())), data=data)
    if must_exist and not settings.data.exists():
        remedy = "give --data, or --journal of the console"
        raise RequestError(settings.data, "there is no file of a console", remedy=remedy)
    return Accounts(settings.data)


def _me() -> str:
    """Return the user of the command line, for the audit."""
    import getpass

    try:
        return f"{getpass.getuser()} (command line)"
    except (OSError, KeyError):
        return "command line"


def _link(name: str, secret: str, address: str, *, json: bool) -> None:
    link = f"{address.rstrip('/')}/welcome#{secret}"
    if json:
        show.print_json({"name": name, "link": link})
        return
    show.people.print(f"{visible(name)} chooses a password here, once and within a day:", soft_wrap=True)
    show.people.print(Text(link), soft_wrap=True)
