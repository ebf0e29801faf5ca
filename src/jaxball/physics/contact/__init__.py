"""What dry friction holds or moves: the contact of a body with its ground, its turning over it, and its joints.

:class:`~jaxball.physics.contact.body_on_plane.BodyOnPlane` fulfils the contract of hybrid systems, and nothing outside
this folder knows its modes, except what shows them.
"""
