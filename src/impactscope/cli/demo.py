"""``impactscope demo``: the live graph, and what simulations leave out."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from impactscope.cli.console import Bar, out
from impactscope.cli.explain import print_answer
from impactscope.cli.printing import print_blow, print_summary, print_test_point

__all__ = ['demo']

CONCEALED = 'coulomb_friction:force=1'


def demo(
    output: Annotated[
        Path, typer.Option('--output', '-o', help='Folder for what is made.')
    ] = Path('out'),
) -> None:
    """Run the live graph on a real recording and on simulated blows; find missing physics."""
    _graph(output)
    _explanations(output)


def _graph(output: Path) -> None:
    from impactscope.live import demo_steps
    from impactscope.report import write_report

    for step in demo_steps(output):
        out.rule(escape(step.title))
        result = step.run(on_result=print_blow, on_test_point=print_test_point)
        print_summary(result, test_points=False)
        report = output / f'demo_{step.name}.html'
        write_report(result, report)
        out.print(f'report: [bold]{escape(str(report))}[/bold]')


def _explanations(output: Path) -> None:
    from impactscope.configuration import bags_folder
    from impactscope.drivers.simulated_campaign import parse_effect, write_campaign

    out.rule('A real pendulum, simulated as linear: what is missing?')
    _explain(bags_folder() / 'pendulum_campaign.yaml', output / 'demo_missing_pendulum.html')
    out.rule('A simulated bench that conceals an effect: what is missing?')
    folder = output / 'demo_concealed'
    write_campaign(folder, [parse_effect(CONCEALED)], blows=4, sample_rate=2500.0)
    _explain(folder, output / 'demo_missing_concealed.html')
    out.print(f'concealed was: {CONCEALED}')


def _explain(campaign: Path, report: Path) -> None:
    from impactscope.campaign_files import explain_folder
    from impactscope.report.explain_report import write_explanation

    with Bar(f'explaining {campaign.stem}') as advance:
        answer = explain_folder(campaign, advance.describe)
    print_answer(answer)
    write_explanation(answer, report)
    out.print(f'report: [bold]{escape(str(report))}[/bold]')
