"""Node: collects blows and says which physics the simulation leaves out.

``events`` in; service ``explain_campaign``; ``model_mismatch`` out, latched. What stands on the
bench is described by a ``campaign.yaml`` (parameter ``campaign``): its n-th recording describes
the n-th blow; the files it names are not read.
"""

from __future__ import annotations

import json
import threading
from typing import Any

from impactscope import msg, srv
from impactscope.campaign_files import load_campaign
from impactscope.discrepancy.answer import Answer
from impactscope.discrepancy.campaign import Campaign
from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.time_limit import WITHIN_S
from impactscope.errors import ConfigurationError, ImpactscopeError
from impactscope.nodes import qos
from impactscope.nodes.base import StageNode
from impactscope.nodes.conversions import to_record
from impactscope.nodes.parameters import declare, refuse_unknown
from impactscope.records import ImpactEvent

__all__ = ['Discrepancy']


class Discrepancy(StageNode):
    """Runs :func:`~impactscope.discrepancy.explain` on the events collected, in a thread."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__('discrepancy', **keywords)
        path = declare(self, 'campaign', '', 'campaign.yaml that describes bench and blows')
        self._within_s = declare(
            self, 'within_s', WITHIN_S, 's, after which a search only finishes what it has to'
        )
        refuse_unknown(self)
        if not path:
            raise ConfigurationError('discrepancy: campaign is empty; name a campaign.yaml')
        self._campaign: Campaign = load_campaign(path, samples=False)
        self._events: list[ImpactEvent] = []
        self._thread: threading.Thread | None = None
        self._said = ''
        self._lock = threading.Lock()
        self._publisher = self.create_publisher(msg.ModelMismatch, 'model_mismatch', qos.LATCHED)
        self.create_subscription(msg.ImpactEvent, 'events', self.guard(self._on_event), qos.EVENTS)
        self.create_service(srv.ExplainCampaign, 'explain_campaign', self._explain)

    def _on_event(self, message: msg.ImpactEvent) -> None:
        with self._lock:
            self._events.append(to_record(message))

    def _explain(
        self, request: srv.ExplainCampaign.Request, response: srv.ExplainCampaign.Response
    ) -> srv.ExplainCampaign.Response:
        with self._lock:
            events = list(self._events)
            if request.forget:
                self._events.clear()
        if self._thread is not None and self._thread.is_alive():
            response.message = 'a search is under way; wait for its answer'
        elif not events:
            response.message = 'no blow has been collected'
        elif len(events) > (planned := len(self._campaign.recordings)):
            response.message = (
                f'{len(events)} blows were collected, but the campaign describes {planned}; '
                'begin a new one with forget'
            )
        else:
            self._thread = threading.Thread(target=self._search, args=(events,), daemon=True)
            self._thread.start()
            response.success = True
            response.message = f'looking at {len(events)} blows'
        return response

    def _search(self, events: list[ImpactEvent]) -> None:
        try:
            answer = explain(self._campaign.with_events(events), within_s=self._within_s)
        except ImpactscopeError as error:
            self._said = f'no answer: {error}'
            self.get_logger().error(f'discrepancy: {error}')
            return
        self._said = answer.summary()
        self._publisher.publish(self._message(answer, events))
        self.published += 1

    def _message(self, answer: Answer, events: list[ImpactEvent]) -> msg.ModelMismatch:
        message = msg.ModelMismatch(
            campaign=answer.campaign,
            event_ids=[event.event_id for event in events],
            detected=answer.mismatch.detected,
            p_value=float(answer.mismatch.p_value),
            subsystems=list(answer.mismatch.subsystems),
            accepted=list(dict.fromkeys(answer.accepted)),
            candidates=[finding.name for finding in answer.ranking],
            probabilities=[float(finding.probability) for finding in answer.ranking],
            unexplained=answer.unexplained,
            summary=answer.summary(),
            next_tests=list(answer.next_tests),
            json=json.dumps(answer.to_json()),
        )
        message.header.stamp = self.get_clock().now().to_msg()
        return message

    def finish(self) -> None:
        """Let a search come to its end."""
        if self._thread is not None:
            self._thread.join()

    def state(self) -> tuple[str, dict[str, Any]]:
        """The last answer."""
        return '', {'collected': len(self._events), 'answer': self._said}
